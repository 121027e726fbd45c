// Signs in with the code behind the "#" of the address, or with a token.

const told = document.getElementById("told");

/** Returns the address of this coordinator that is asked for; no other site's. */
function next() {
  const wanted = new URLSearchParams(location.search).get("next") ?? "/";
  const url = new URL(wanted, location.origin);
  return url.origin === location.origin && /^https?:$/.test(url.protocol) ? url.href : "/";
}

async function signIn(body) {
  let answer;
  try {
    answer = await fetch("/sign-in", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
    });
  } catch {
    told.textContent = "The coordinator does not answer.";
    return;
  }
  if (answer.ok) location.replace(next());
  else told.textContent = (await answer.json()).detail ?? "It did not work.";
}

document.getElementById("sign-in").addEventListener("submit", (event) => {
  event.preventDefault();
  signIn({ token: event.target.elements.token.value });
});

function useCode() {
  const code = location.hash.slice(1);
  if (!code) return;
  history.replaceState(null, "", location.pathname + location.search);
  signIn({ code });
}

// An address that is pasted into this very tab changes only what is behind its "#".
addEventListener("hashchange", useCode);
useCode();

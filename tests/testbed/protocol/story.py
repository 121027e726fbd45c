"""What workers, an operator, the clock and a failing database do, in any order."""

import gzip
import json
from functools import partial

from hypothesis import strategies as st
from hypothesis.stateful import initialize, precondition, rule

from server.operations.fleet import comparisons, leases
from server.operations.study import reruns
from tests.testbed.protocol.beside import HOSTS, TTL, Beside
from tests.testbed.protocol.records import SERVED, Json

PATIENCE = 10_000.0
WIDTH = 4
SAID: dict[str, Json] = {
    "ok": {"outcome": "ok", "outputs": {"y": 1.5}},
    "other": {"outcome": "ok", "outputs": {"y": 2.5}},
    "nothing": {"outcome": "ok", "outputs": {}},
    "reserved": {"outcome": "lost", "outputs": {}},
    "diverged": {"outcome": "diverged", "outputs": {}},
    "crashed": {"outcome": "crashed", "outputs": {}},
    "timed_out": {"outcome": "timed_out", "outputs": {}},
}
WORDS = st.lists(st.sampled_from(["ok", "ok", "ok", *SAID]), min_size=1, max_size=4)
NUMBERS = st.integers(0, 9)
MOST = st.integers(1, 6)
ANY_HOST = st.sampled_from(list(HOSTS))


class Story(Beside):
    """What workers, an operator, the clock and the database do to both."""

    # What an operator does.

    @initialize()
    def begin(self) -> None:
        self.submit(rows=2)
        self.submit(rows=1)

    @precondition(lambda self: len(self.model.studies) < 4)
    @rule(rows=st.integers(1, 2))
    def submit(self, rows: int) -> None:
        # Of two that are made at the same moment either may stand first.
        self.wall.advance(1.0)
        name = f"study {next(self.names)}"
        body = {"name": name, "model": "ishigami", "method": "morris", "rows": rows}
        answer = self._ask("POST", "/studies", body, headers={"Idempotency-Key": name})
        if answer is None:
            return
        assert answer.status_code == 201, answer.text
        study = self.model.add(answer.json(), width=WIDTH)
        assert answer.json()["instances"] == study.instances
        again = self._ask("POST", "/studies", body, headers={"Idempotency-Key": name})
        if again is not None:
            assert (again.status_code, again.json()["id"]) == (200, study.id)

    def _any_study(self, number: int) -> str:
        known = [*self.model.studies, "0123456789ab"]
        return known[number % len(known)]

    @rule(number=NUMBERS, action=st.sampled_from(["pause", "resume", "resume", "drain"]))
    def control(self, number: int, action: str) -> None:
        study = self._any_study(number)
        answer = self._ask("POST", f"/studies/{study}/{action}")
        if answer is not None:
            assert answer.status_code == self.model.control(study, action)

    @rule(number=NUMBERS, cancelled=st.booleans())
    def end(self, number: int, cancelled: bool) -> None:
        study = self._any_study(number)
        if cancelled:
            answer = self._ask("POST", f"/studies/{study}/cancel")
            if answer is not None:
                assert answer.status_code == self.model.control(study, "cancel")
        answer = self._ask("DELETE", f"/studies/{study}")
        if answer is not None:
            assert answer.status_code == self.model.control(study, "delete")

    @rule(number=NUMBERS, rows=st.integers(1, 3))
    def extend(self, number: int, rows: int) -> None:
        study = self._any_study(number)
        answer = self._ask("POST", f"/studies/{study}/extend", {"rows": rows})
        if answer is not None:
            assert answer.status_code == self.model.extend(study, rows)

    @rule(number=NUMBERS, which=st.sampled_from(["failed", "all"]), some=st.booleans())
    def rerun(self, number: int, which: str, some: bool) -> None:
        study = self._any_study(number)
        outcomes = ["crashed", "diverged"] if some and which == "failed" else None
        body = {"which": which, "outcomes": outcomes}
        answer = self._ask("POST", f"/studies/{study}/rerun", body)
        if answer is not None:
            status, taken_back = self.model.rerun(study, which, outcomes, self.now)
            told = answer.json().get("taken_back")
            assert answer.status_code == status
            assert told == taken_back or (self.again and told == 0)

    # What workers do.

    def _request(self, host: str, most: int) -> Json:
        worker = {"id": f"of-{host}", "host": host, "versions": {"platform": HOSTS[host]}}
        return {"worker": worker, "models": ["ishigami"], "max_instances": most}

    def _granted(self, host: str, most: int, found: Json | None) -> None:
        if found is None:
            self.model.refuse(host, self.now)
        else:
            self.model.grant(host, most, found, self.now)

    @rule(host=ANY_HOST, most=MOST)
    def lease(self, host: str, most: int) -> None:
        answer = self._ask("POST", "/leases", self._request(host, most))
        if answer is None:
            return
        self.model.reap(self.now)
        found = answer.json() if answer.status_code == 201 else None
        assert found or answer.status_code == 204
        self._granted(host, most, found)

    @precondition(lambda self: self.model.leases)
    @rule(
        number=NUMBERS,
        words=WORDS,
        wrong=st.sampled_from(["", "", "", "", "fence", "worker", "lease"]),
        twice=st.booleans(),
        stray=st.booleans(),
        then=st.none() | st.tuples(ANY_HOST, MOST),
        packed=st.booleans(),
    )
    def post(
        self,
        number: int,
        words: list[str],
        wrong: str = "",
        twice: bool = False,
        stray: bool = False,
        then: tuple[str, int] | None = None,
        packed: bool = False,
    ) -> None:
        lease = [*self.model.leases.values()][-1 - number % len(self.model.leases)]
        said = [
            {"instance": f"{lease.study}:{row}:{position}", **SAID[words[n % len(words)]]}
            for n, (row, position) in enumerate(lease.places)
        ]
        said += said[:1] if twice else []
        said += [{"instance": f"{lease.study}:99:0", **SAID["ok"]}] if stray else []
        body = {
            "lease": "nobody's" if wrong == "lease" else lease.id,
            "fence": lease.fence + (wrong == "fence"),
            "worker": "somebody" if wrong == "worker" else lease.worker,
            "results": said,
        }
        if then is not None:
            body["next"] = self._request(*then)
        content = json.dumps(body).encode()
        headers = {"Content-Type": "application/json"}
        if packed:
            headers["Content-Encoding"] = "gzip"
        content = gzip.compress(content) if packed else content
        answer = self._ask("POST", "/results", content=content, headers=headers)
        if answer is None:
            return
        if then is not None:
            self.model.reap(self.now)
        due = self.model.verdicts(body["lease"], body["fence"], body["worker"], said, self.now)
        told = [one["verdict"] for one in answer.json()["verdicts"]]
        if self.again:
            # It may have been taken before.
            told = [d if t == "duplicate" and d else t for t, d in zip(told, due, strict=True)]
        assert [t for t, d in zip(told, due, strict=True) if d] == [d for d in due if d]
        refused = {"conflict", "unknown", "invalid"} & {*told}
        assert answer.status_code == (409 if refused else 200)
        self._settle()
        if then is not None:
            self._granted(*then, answer.json()["next"])

    @precondition(lambda self: self.model.leases)
    @rule(number=NUMBERS, wrong=st.booleans())
    def renew(self, number: int, wrong: bool = False) -> None:
        lease = [*self.model.leases.values()][-1 - number % len(self.model.leases)]
        fence = lease.fence + wrong
        answer = self._ask("POST", f"/leases/{lease.id}/renew", {"fence": fence})
        if answer is None:
            return
        due = self.model.renew(lease.id, fence, self.now)
        if lease.compares and due:
            # It may be over: the model does not follow second opinions.
            lease.state = "open" if answer.status_code == 200 else "finished"
            return
        assert answer.status_code == (200 if due else 409)
        if due:
            assert answer.json()["expires_at"] == lease.expires

    @precondition(lambda self: self.model.leases)
    @rule(number=NUMBERS, wrong=st.booleans())
    def release(self, number: int, wrong: bool = False) -> None:
        lease = [*self.model.leases.values()][-1 - number % len(self.model.leases)]
        fence = lease.fence + wrong
        answer = self._ask("POST", f"/leases/{lease.id}/release", {"fence": fence})
        if answer is not None:
            due = self.model.release(lease.id, fence, self.now)
            assert answer.status_code == (200 if due else 409)

    @rule(host=ANY_HOST, times=st.integers(2, 6), silent=st.booleans())
    def go_wrong(self, host: str, times: int, silent: bool) -> None:
        """Have a worker fall silent, or crash, over instances again and again."""
        for _ in range(times):
            known = len(self.model.leases)
            self.lease(host, 2)
            if len(self.model.leases) == known:
                return
            if silent:
                self.wait(TTL)
                self.take_back()
            else:
                self.post(0, ["crashed"])

    # What nobody asks for.

    @rule(seconds=st.sampled_from([100.0, TTL / 2, TTL, PATIENCE]))
    def wait(self, seconds: float) -> None:
        self.wall.advance(seconds)

    @rule()
    def take_back(self) -> None:
        """Do what the coordinator does by itself every quarter of a lease's time."""
        engine, now = self.app.state.engine, self.now
        leases.reap(engine, now=now, ttl=TTL)
        self.model.reap(now)
        self._settle()
        comparisons.give_up(engine, now=now, patience=PATIENCE)
        reruns.free_stranded_rows(engine, now=now, patience=PATIENCE)
        self.model.free_stranded(now, PATIENCE)

    @rule(
        statements=st.integers(0, 14),
        lasting=st.booleans(),
        what=st.sampled_from(["lease", "post", "then", "rerun", "extend", "end", "release"]),
        number=NUMBERS,
        host=ANY_HOST,
        words=WORDS,
    )
    def database_fails(
        self, statements: int, lasting: bool, what: str, number: int, host: str, words: list[str]
    ) -> None:
        """Have the database fail in the midst of a request.

        It is done wholly or not at all. What takes a second transaction to answer may be done and
        not answered: whoever asks again is answered, and nothing is done twice.
        """
        # Otherwise what has run out could be taken back in a transaction before.
        self.take_back()
        if what in ("post", "then", "release") and not self.model.leases:
            what = "lease"
        ask = {
            "lease": partial(self.lease, host, 3),
            "post": partial(self.post, number, words),
            "then": partial(self.post, number, words, then=(host, 3)),
            "rerun": partial(self.rerun, number, "all", some=False),
            "extend": partial(self.extend, number, 3),
            "end": partial(self.end, number, cancelled=False),
            "release": partial(self.release, number),
        }[what]
        self.unanswered = False
        self.faults.arm(statements, lasting=lasting)
        try:
            ask()
        finally:
            self.faults.disarm()
        if self.unanswered and what in ("then", "rerun", "extend"):
            self.again = True
            ask()
            self.again = False

    @rule(hours=st.sampled_from([-1, 0, 1]))
    def restart(self, hours: int) -> None:
        """Stop the coordinator and start it, perhaps with another time on the wall."""
        before = self.now
        self.client.__exit__(None, None, None)
        # Nobody can know of more than it was told of.
        self.wall.now = before + 3600.0 * hours
        heard = max(self.model.heard.values(), default=0.0)
        self._start()
        assert self.now >= heard
        self.model.restart(self.now)

    def teardown(self) -> None:
        """Bring every study to its end, with one diligent machine of each kind."""
        try:
            for number, study in enumerate([*self.model.studies.values()]):
                if study.state in ("paused", "draining"):
                    self.control(number, "resume")
            for _ in range(12):
                if not any(study.state in SERVED for study in self.model.studies.values()):
                    break
                self.wait(TTL)
                self.take_back()
                for host in HOSTS:
                    before = -1
                    while before != (before := len(self.model.leases)):
                        self.lease(host, 8)
                        self.post(0, ["ok"])
            self.is_as_the_model_says()
            self._is_told()
            for study in self.model.studies.values():
                assert study.state == "cancelled" or len(study.done()) == study.instances
        finally:
            self.client.__exit__(None, None, None)

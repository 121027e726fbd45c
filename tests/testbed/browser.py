"""A real browser, where there is one: whatever it complains of must be nothing."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)
needs_browser = pytest.mark.skipif(
    BROWSER is None, reason="there is no Chromium on this machine: `make browser` installs it"
)
QUIET = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
#: What Chromium says of every form with a password and no user.
_ADVICE = "[DOM] Password forms"


@contextmanager
def launched() -> Iterator[Any]:
    """Start a browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=QUIET)
        yield browser
        browser.close()


def watched(page: Any, origin: str) -> list[str]:
    """Return a list that fills with a page's complaints, and with requests that leave `origin`."""
    complaints: list[str] = []

    def said(message: Any) -> None:
        if not message.text.startswith(_ADVICE):
            complaints.append(message.text)

    def asked(request: Any) -> None:
        if not request.url.startswith(("data:", "blob:")):
            parts = urlsplit(request.url)
            if f"{parts.scheme}://{parts.netloc}" != origin:
                complaints.append(f"asked for {request.url}")

    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", said)
    page.on("request", asked)
    return complaints

"""What open pages cost a coordinator, and how soon one shows a study of a million instances.

`python -m benchmarks.service.page`. A worker leases and posts in blocks, by turns with no tab open
and with 50, half of them on all studies and half on the one under way; the processor time that the
coordinator takes for an instance is compared within each pair. The first paint is Chromium's own,
the first in which there is something to read; by turns of a study of a million instances and of a
thousand, so that what the size costs is not what else the machine does.
"""

import selectors
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from urllib.parse import urlsplit

from analysis.sensitivity.service import catch_up
from benchmarks.machine import describe_machine
from benchmarks.measuring import Target, cpu_seconds
from benchmarks.service.coordinator import TOKEN, complete, coordinator, submit
from benchmarks.service.million import BATCH, ROWS, WIDTH, WORKER, fill
from rehyb.client import Client
from server.operations.study.result_log import StoreResultLog
from server.store import create_engine

TABS = 50
#: Instances of a study, of a block, and blocks of either kind.
INSTANCES = 100_000
BLOCK, PAIRS = 4_000, 12
#: Pages that are opened of each study to see when they paint, and rows of the small one.
PAINTS = 9
SMALL_ROWS = 200
#: Seconds for which tabs are looked at that have nothing else beside them.
IDLE_SECONDS = 10.0


@contextmanager
def tabs(url: str, paths: Sequence[str]) -> Iterator[None]:
    """Listen to pages as so many tabs do, in a thread that throws away what it hears."""
    where = urlsplit(url)
    selector, stop = selectors.DefaultSelector(), threading.Event()
    for path in paths:
        tab = socket.create_connection((where.hostname or "", where.port or 80))
        head = (
            f"GET {path} HTTP/1.1\r\nHost: {where.netloc}\r\nAuthorization: Bearer {TOKEN}\r\n\r\n"
        )
        tab.sendall(head.encode())
        tab.setblocking(False)
        selector.register(tab, selectors.EVENT_READ)

    def drain() -> None:
        while not stop.is_set():
            for key, _ in selector.select(0.1):
                key.fileobj.recv(1 << 20)  # type: ignore[union-attr]

    thread = threading.Thread(target=drain)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        for key in [*selector.get_map().values()]:
            key.fileobj.close()  # type: ignore[union-attr]


def block(client: Client, pid: int) -> float:
    """Return the coordinator's processor time per instance, ms."""
    before, finished = cpu_seconds([pid]), 0
    while finished < BLOCK:
        finished += complete(client, WORKER, 10)
    return (cpu_seconds([pid]) - before) / finished * 1e3


def under_way(directory: Path) -> tuple[list[tuple[float, float]], float]:
    """Return processor time per instance without and with tabs, in pairs; and of idle tabs."""
    url = f"sqlite:///{directory / 'page.sqlite3'}"
    with coordinator(url) as running, Client(running.url, TOKEN) as client:
        study = submit(running.url, INSTANCES // WIDTH)
        log = StoreResultLog(create_engine(url))
        paths = ["/live/", f"/live/studies/{study['id']}"] * (TABS // 2)
        block(client, running.pid)
        pairs = []
        for _ in range(PAIRS):
            # As the analysis does, so that there is something to show.
            catch_up(log, study["id"])
            without = block(client, running.pid)
            with tabs(running.url, paths):
                time.sleep(1.0)
                pairs.append((without, block(client, running.pid)))
        with tabs(running.url, paths):
            time.sleep(2.0)
            before = cpu_seconds([running.pid])
            time.sleep(IDLE_SECONDS)
            idle = (cpu_seconds([running.pid]) - before) / IDLE_SECONDS
    return pairs, idle


@dataclass(frozen=True, kw_only=True)
class Opened:
    """How soon a page was there, ms after it was asked for."""

    answered: float
    painted: float


#: The page's policy forbids what waits for a condition by evaluating a text, again and again.
_TIMES = """() => new Promise((tell) => {
  new PerformanceObserver((seen) => {
    const [paint] = seen.getEntriesByName("first-contentful-paint");
    const [page] = performance.getEntriesByType("navigation");
    if (paint) tell([page.responseEnd, paint.startTime]);
  }).observe({type: "paint", buffered: true});
})"""


def opened(directory: Path) -> dict[int, list[Opened]]:
    """Return how soon Chromium shows studies, by their instances; none without a browser."""
    from tests.testbed.browser import BROWSER, launched

    if BROWSER is None:
        return {}
    file = directory / "million.sqlite3"
    url = f"sqlite:///{file}"
    with coordinator(url) as running, Client(running.url, TOKEN) as client:
        log = StoreResultLog(create_engine(url))
        studies = {SMALL_ROWS * WIDTH: submit(running.url, SMALL_ROWS)["id"]}
        while complete(client, WORKER, BATCH):
            pass
        studies[ROWS * WIDTH] = submit(running.url, ROWS)["id"]
        complete(client, WORKER, WIDTH)
        fill(file, studies[ROWS * WIDTH])
        for study in studies.values():
            while catch_up(log, study):
                pass
        complete(client, WORKER, BATCH)
        with launched() as browser:
            page = browser.new_page()
            page.goto(client.page_address())
            page.wait_for_url(f"{running.url}/")
            found: dict[int, list[Opened]] = {size: [] for size in studies}
            for _ in range(PAINTS):
                for size, study in studies.items():
                    page.goto(f"{running.url}/studies/{study}", wait_until="load")
                    answered, painted = page.evaluate(_TIMES)
                    found[size].append(Opened(answered=answered, painted=painted))
    return found


def main() -> None:
    print(describe_machine())
    with tempfile.TemporaryDirectory() as directory:
        pairs, idle = under_way(Path(directory))
        pages = opened(Path(directory))
    slower = [late / early - 1.0 for early, late in pairs]
    print(f"Coordinator's processor time for an instance, {len(pairs)} pairs of {BLOCK} instances:")
    before, after = (median(found) for found in zip(*pairs, strict=True))
    print(f"  no tab {before:.3f} ms, {TABS} tabs {after:.3f} ms")
    print(f"  pairs: {', '.join(f'{share:+.1%}' for share in sorted(slower))}")
    print(f"{TABS} tabs beside nothing else: {idle:.2%} of a core")
    for size, found in pages.items():
        painted = sorted(one.painted for one in found)
        print(
            f"first paint of {size:,} instances: {', '.join(f'{ms:.0f}' for ms in painted)} ms; "
            f"the page had come after {median(one.answered for one in found):.0f} ms"
        )
    paints = [one.painted for one in pages.get(ROWS * WIDTH, ())]
    if paints:
        fewer = median(one.painted for one in pages[SMALL_ROWS * WIDTH])
        print(f"a thousand times the instances: {median(paints) / fewer:.2f} times as long")
    targets = [
        Target(
            what="tabs slow an instance by",
            figure=100.0 * median(slower),
            bound=10.0,
            unit="%",
            at_least=False,
        ),
        Target(
            what="first paint",
            figure=median(paints) if paints else float("nan"),
            bound=300.0,
            unit="ms",
            at_least=False,
        ),
    ]
    for target in targets:
        print(target.line())
    sys.exit(not all(target.met for target in targets))


if __name__ == "__main__":
    main()

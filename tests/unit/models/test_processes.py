"""What a process started is told, whatever ends meanwhile."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from models.processes import children, descendants

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are read from /proc")


@pytest.fixture
def family() -> Iterator[tuple[int, int]]:
    """Yield a process and what it started."""
    started = subprocess.Popen(["sh", "-c", "sleep 60 & echo $!; wait"], stdout=subprocess.PIPE)
    assert started.stdout is not None
    grandchild = int(started.stdout.readline())
    yield started.pid, grandchild
    os.kill(grandchild, 9)
    started.wait()
    started.stdout.close()


def test_children_of_children_are_descendants(family: tuple[int, int]) -> None:
    child, grandchild = family
    assert child in children(os.getpid()) and grandchild not in children(os.getpid())
    assert {child, grandchild} <= set(descendants(os.getpid()))


@pytest.mark.parametrize("gone", [FileNotFoundError, ProcessLookupError])
def test_a_process_that_ends_while_it_is_looked_at_has_no_children(
    gone: type[OSError], family: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    scan, (child, grandchild) = os.scandir, family

    def ended(path: str) -> object:
        if path.split("/")[2] == str(child):
            raise gone(path)
        return scan(path)

    monkeypatch.setattr("os.scandir", ended)
    found = descendants(os.getpid())
    assert child in found and grandchild not in found

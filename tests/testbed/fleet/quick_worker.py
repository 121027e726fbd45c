"""A worker as `python -m worker` is one, which does not simulate the nominal elbow first.

That is most of its start. Workers of one test are on one machine; what the canary is for, and that
a worker begins with it, is tested by those that `LocalFleet` starts.
"""

from worker import cli, machine

if __name__ == "__main__":
    machine.canary = lambda: ("the same", 0.5, [])  # type: ignore[assignment]
    cli.main()

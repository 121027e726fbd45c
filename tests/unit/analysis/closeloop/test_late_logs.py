"""The time of a limb's log, less than a sample, is asked for before the names beside it."""

from types import SimpleNamespace

import pytest

from analysis.closeloop import loop
from analysis.closeloop.contract import Verdict


class Found(SimpleNamespace):
    """A trace as far as names and what they stand beside matter."""

    def without_names(self, _note: str) -> "Found":
        return Found(steps=(), model=self.model, log="as it is")


def found(*names: str, log: str = "as it is", late: bool = False) -> Found:
    steps = tuple(SimpleNamespace(key=(name, 0)) for name in names)
    verdict = Verdict.EFFECT_FOUND if names else Verdict.ADEQUATE
    return Found(steps=steps, model=SimpleNamespace(late=late), log=log, verdict=verdict)


@pytest.fixture
def of_logs(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[str, ...]]:
    """Return the names that a trace of each log finds; a log's time is in its own name."""
    names: dict[str, tuple[str, ...]] = {}
    monkeypatch.setattr(loop, "tells_time", lambda model: model.late)
    monkeypatch.setattr(loop, "trace", lambda log, _progress: found(*names[log], log=log))

    def synchronised(trace: Found) -> tuple[str, str]:
        told = "beside the names" if trace.steps else "alone"
        return (told, f"told {told}") if told in names else (trace.log, "")

    monkeypatch.setattr(loop, "synchronised_limb", synchronised)
    return names


def named(trace: Found, of_logs: dict[str, tuple[str, ...]]) -> tuple[list[str], str]:
    taken, said = loop._synchronised(trace, lambda _: None)  # type: ignore[arg-type]
    return [step.key[0] for step in taken.steps], said


def test_a_log_s_time_that_leaves_nothing_to_name_stands_alone(
    of_logs: dict[str, tuple[str, ...]],
) -> None:
    """Half a millisecond of a clean limb's log was series elasticity beside a fifth of it."""
    of_logs |= {"alone": (), "beside the names": ("series_elasticity",)}
    assert named(found("series_elasticity"), of_logs) == ([], "told alone")


def test_where_less_but_something_is_named_without_it_the_time_is_told_beside_the_names(
    of_logs: dict[str, tuple[str, ...]],
) -> None:
    """It took the place of friction beside hysteresis, a third of a sample long."""
    of_logs |= {"alone": ("hysteresis",), "beside the names": ("hysteresis", "stribeck_friction")}
    told = (["hysteresis", "stribeck_friction"], "told beside the names")
    assert named(found("hysteresis", "stribeck_friction"), of_logs) == told


def test_beside_an_effect_that_is_late_nothing_is_asked(
    of_logs: dict[str, tuple[str, ...]],
) -> None:
    """A log's time would stand in for a delay that is shorter than a sample."""
    of_logs["alone"] = ()
    late = found("time_delay", late=True)
    assert named(late, of_logs) == (["time_delay"], "")

"""The time of a limb's log, less than a sample, is asked for before the names beside it."""

from types import SimpleNamespace

import pytest

from analysis.closeloop import loop


class Found(SimpleNamespace):
    """A trace as far as names and what they take matter."""

    def without_names(self, _note: str) -> "Found":
        return Found(**{**vars(self), "steps": ()})


def found(*names: str, log: str = "as it is", late: bool = False) -> Found:
    """Return a trace of which the declared model leaves 100, and the names 10."""
    return Found(
        steps=tuple(SimpleNamespace(key=(name, 0)) for name in names),
        model=SimpleNamespace(late=late),
        log=log,
        declared_score=SimpleNamespace(loss=100.0),
        score=SimpleNamespace(loss=10.0),
    )


def named(
    trace: Found, takes: float, alone: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> tuple[list[str], str]:
    """Return the names that are told, and what is said of the log's time.

    Args:
        trace: what was found in the log as it is.
        takes: loss that the time takes alone; beside names it always takes enough.
        alone: names that are found in the log at its own time.
    """
    names = {"alone": alone, "beside the names": tuple(step.key[0] for step in trace.steps)}
    monkeypatch.setattr(loop, "tells_time", lambda model: model.late)
    monkeypatch.setattr(loop, "trace", lambda log, _progress: found(*names[log], log=log))

    def synchronised(trace: Found, least: float = 0.0) -> tuple[str, str]:
        if trace.steps:
            return ("", "") if trace.model.late else ("beside the names", "told beside the names")
        return ("alone", "told alone") if takes >= least else ("", "")

    monkeypatch.setattr(loop, "synchronised_limb", synchronised)
    taken, said = loop._synchronised(trace, lambda _: None)  # type: ignore[arg-type]
    return [step.key[0] for step in taken.steps], said


def test_a_log_s_time_that_takes_what_names_take_stands_before_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half a millisecond of a clean limb's log was series elasticity beside a fifth of it."""
    told = named(found("series_elasticity"), 85.0, (), monkeypatch)
    assert told == ([], "told alone")


def test_a_time_that_takes_less_is_told_beside_the_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cuff's spring is late, too; and friction beside hysteresis had given way to a time."""
    told = named(found("series_elasticity"), 60.0, (), monkeypatch)
    assert told == (["series_elasticity"], "told beside the names")


def test_beside_an_effect_that_is_late_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log's time would stand in for a delay that is shorter than a sample."""
    told = named(found("time_delay", late=True), 90.0, (), monkeypatch)
    assert told == (["time_delay"], "")

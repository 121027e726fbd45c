"""What stands out is judged beside the effect that seems to be there, be it sure or not."""

from types import SimpleNamespace
from typing import Any

import pytest

from analysis.closeloop import loop
from analysis.closeloop.judgement.events import Standing
from analysis.closeloop.session.recording import Recording


@pytest.mark.parametrize("supposed", [True, False])
def test_pushes_beside_an_effect_that_cannot_be_told_are_judged_with_it(
    supposed: bool, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None of twelve pushes beside a load was told: the load, unnamed, stood out with them."""
    asked: list[Any] = []

    def standing_out(model: Any, _recording: Recording) -> Standing:
        asked.append(model)
        return Standing(told=(), doubted=())

    found = SimpleNamespace(fit_of_steps=("with the load" if supposed else "as declared", None))
    monkeypatch.setattr(loop, "wound_up", lambda trace: trace)
    monkeypatch.setattr(loop, "unnamed_loads", lambda trace: ())
    monkeypatch.setattr(loop, "standing_out", standing_out)
    loop._events(found, recording)  # type: ignore[arg-type]
    assert asked == ["with the load" if supposed else "as declared"]

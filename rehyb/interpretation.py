"""Interpret a recording on this machine: what the command and a worker's job share."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rehyb.errors import check_pictures, refusing
from rehyb.whole_files import whole_file


def bank_file(chosen: Path | None = None) -> Path:
    """Return the bank's file: the one `chosen`, REHYB_BANK, or one in the user's data folder."""
    if chosen is not None:
        return chosen
    if from_environment := os.environ.get("REHYB_BANK"):
        return Path(from_environment)
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "rehyb" / "bank.npz"


def interpret_recording(
    recording: Path,
    bank: Path | None = None,
    *,
    known: Iterable[tuple[str, float, float]] = (),
    tolerance: float | None = None,
    report: Path | None = None,
    answered: Callable[[dict[str, Any]], None] = lambda found: None,
) -> dict[str, Any]:
    """Return K_h and D_h of a recording with intervals (`docs/use/interpretation.md`).

    Args:
        recording: a file of `rehyb assess --record`, or a measured session (folder or zip).
        bank: its file; default as `bank_file`.
        known: what was measured on the patient: factor, value and standard deviation, SI units.
        tolerance: half width of K's 90 % interval that is wanted, Nm/rad.
        report: an HTML page to write.
        answered: called with the answer before the report is written.

    Raises:
        Invalid: recording, bank or a known value cannot be used; one sentence.
        RehybError: nothing draws the report here.
        OSError: the report cannot be written.
    """
    from analysis.interpretation.answer import Question, interpret
    from analysis.interpretation.bank.bank import load_bank
    from analysis.interpretation.errors import InterpretationError
    from analysis.interpretation.inference.interpreter import Known
    from analysis.interpretation.recording import read_recording

    measured = tuple(Known(name=name, value=value, sd=sd) for name, value, sd in known)
    with refusing(InterpretationError):
        question = Question(
            recording=read_recording(recording), known=measured, tolerance=tolerance
        )
        learnt = load_bank(bank_file(bank))
        found = interpret(learnt, question)
    answered(found)
    if report is not None:
        check_pictures()
        from analysis.interpretation.page import write_page

        before = None
        if measured and found["familiar"]:
            alone = interpret(learnt, Question(recording=question.recording))
            before = alone["half_width"]
        with whole_file(report) as partial:
            write_page(partial, found, before)
    return found

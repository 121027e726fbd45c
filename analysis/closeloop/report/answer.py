"""The answer to one session: its report, and what the report's pictures and files are made of."""

from dataclasses import dataclass
from typing import Any

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.session.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The content of `report.json`, with the recording and the errors of its trials."""

    report: dict[str, Any]
    recording: Recording
    before: list[TrialError]
    after: list[TrialError]

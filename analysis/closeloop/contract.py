"""What closing the loop promises to the readers of its report: schema, verdicts and files.

Cheap to import: a server or a client learns it without numpy or MuJoCo.
"""

from enum import StrEnum

#: Of `session.json` and of `report.json`.
SCHEMA = 1
#: What a report consists of, in the order in which it is written.
REPORT_FILES = ("report.json", "report.html", "model_after.xml", "residuals.csv")
#: Share of intervals in a report that hold.
CONFIDENCE = 0.9


class Verdict(StrEnum):
    """What a session says about its declared model."""

    #: The residual of the declared model is at its floor.
    ADEQUATE = "adequate"
    #: The model lacked effects that the trials can name.
    EFFECT_FOUND = "effect_found"
    #: Structure is left that no catalogued effect explains.
    UNEXPLAINED = "unexplained"
    #: An effect is there, but these trials cannot name it.
    NOT_IDENTIFIABLE = "not_identifiable"

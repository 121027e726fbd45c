"""All studies: how far each is, how fast, and how precise."""

from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any

from sqlalchemy.engine import Engine

from analysis.reports.wording import left_by_analysis
from analysis.sensitivity.judgement.stopping import Advice, advise
from analysis.sensitivity.records import said_of
from models.curves import names_of
from server.logic.study.progress import Pace, pace
from server.operations.study import precision_goals, studies
from server.operations.study.result_log import StoreResultLog
from server.records import PrecisionGoal, Study
from server.states import StudyState
from server.web.cache import Cache
from server.web.page import Look, Page

#: Studies that one page shows; a filter finds the others.
MOST_SHOWN = 100

#: By the name in the address, what a column is sorted by; the first study has the largest.
SORTS: Mapping[str, Callable[[dict[str, Any]], Any]] = {
    "newest": lambda row: row["study"].created_at,
    "name": lambda row: _backwards(row["study"].plan.name),
    "progress": lambda row: row["done"],
    "failed": lambda row: row["failed_share"],
    "priority": lambda row: row["study"].priority,
}
#: What is said of a study's precision, and whether its snapshot holds all rows that are complete.
PRECISION: Cache[tuple[Advice | None, bool]] = Cache(1000)


def look(asked: Look) -> dict[str, Any]:
    """Return the studies that are asked for."""
    wanted, words = asked.choices.get("state", ""), asked.choices.get("find", "").casefold()
    by = asked.choices.get("sort", "newest")
    by = by if by in SORTS else "newest"
    every, goals = studies.every(asked.engine), precision_goals.every(asked.engine)
    found: list[dict[str, Any]] = [
        {
            "study": study,
            "done": study.result_count / study.plan.instances,
            "failed_share": _failed_share(study),
        }
        for study in every
        if (not wanted or study.state == wanted) and words in _about(study)
    ]
    found.sort(key=SORTS[by], reverse=True)
    shown = found[:MOST_SHOWN]
    for row in shown:
        row |= detail(asked, row["study"], goals.get(row["study"].id))
    return {
        "rows": shown,
        "hidden": len(found) - len(shown),
        "total": len(every),
        "states": [str(state) for state in StudyState],
        "choices": {"state": wanted, "find": asked.choices.get("find", ""), "sort": by},
        "sorts": list(SORTS),
    }


PAGE = Page(path="/", template="studies.html", look=look, choices=("state", "find", "sort"))


def detail(
    asked: Look, study: Study, goal: PrecisionGoal | None, *, whole: bool = False
) -> dict[str, Any]:
    """Return what costs a query of its own: a study's speed, end and precision.

    `whole`: also of one that is not served what waits for its analysis.
    """
    engine, now = asked.engine, asked.now
    standing = None
    if whole or study.state.is_served:
        standing = studies.standing(engine, study.id, now=now, patience=asked.state.patience)
    speed: Pace | None = None
    if standing is not None:
        speed = standing.pace(now)
    elif study.finished_at is not None:
        speed = pace(study, window_opened_at=study.created_at, now=now)
    return {
        "pace": speed,
        "ends_at": None if speed is None or not speed.eta_seconds else now + speed.eta_seconds,
        "workers": 0 if standing is None else standing.workers,
        "waits_for": None if standing is None else standing.waits_for,
        "why_it_waits": None if standing is None else standing.why_it_waits,
        "left": "" if standing is None else left_by_analysis(standing.left_by_analysis),
        "goal": goal,
        "precision": precision(engine, study, goal),
    }


def precision(engine: Engine, study: Study, goal: PrecisionGoal | None) -> Advice | None:
    """Return how wide a study's widest interval is, and how wide it should be; None: too early."""
    if not study.rows_complete:
        return None
    output = goal.output if goal else names_of(study.plan.outputs, study.plan.curves)[0]
    target = goal.target if goal else None

    def find() -> tuple[Advice | None, bool]:
        snapshot = StoreResultLog(engine).snapshot(study.id)
        if snapshot is None or not said_of(snapshot, output):
            return None, False
        found = advise({"sampling": study.plan.sampling, **snapshot}, output, target)
        return found, snapshot["rows_complete"] == study.rows_complete

    key = (study.id, study.edition, study.rows_complete, output, target)
    # Until the analysis is through there is more to say a moment later.
    return PRECISION.of(key, find, stays=itemgetter(1))[0]


def _failed_share(study: Study) -> float:
    return (study.result_count - study.ok_count) / max(study.result_count, 1)


def _about(study: Study) -> str:
    plan = study.plan
    return " ".join((plan.name, plan.model, plan.method, study.id, *study.tags)).casefold()


def _backwards(name: str) -> list[int]:
    """Return what sorts names from the end, so that all sorts have the largest first."""
    return [-ord(letter) for letter in name.casefold()]

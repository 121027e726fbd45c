"""Instances one by one: a listing, and all that is known of one."""

from typing import Any

from sqlalchemy.engine import Engine

from server.errors import NotFoundError
from server.logic.study.instances import BUDGETS
from server.records import Place, Study
from server.states import InstanceState, Outcome
from server.store.database.engine import reading
from server.store.study import evidence, studies


def page(
    engine: Engine,
    study_id: str,
    *,
    state: str | None,
    outcome: str | None,
    after: Place,
    limit: int,
) -> list[dict[str, Any]]:
    """Return up to `limit` instances of begun rows beyond `after`, by row and position.

    Args:
        state: an `InstanceState`, "ok", "failed" or "quarantined"; None: all.
        outcome: only those that ended so.
        after: (row, position) of the last one seen.
    """
    ended: set[str] | None = None
    if state in ("ok", "quarantined"):
        ended = {Outcome.OK} if state == "ok" else {*BUDGETS}
    if outcome is not None:
        ended = {outcome} if ended is None else ended & {outcome}
    with reading(engine) as connection:
        studies.find(connection, study_id)
        return evidence.page(
            connection,
            study_id,
            state=next((known for known in InstanceState if known == state), None),
            outcomes=ended,
            failed=state == "failed",
            after=after,
            limit=limit,
        )


def account(engine: Engine, study_id: str, place: Place) -> tuple[Study, dict[str, Any]]:
    """Return a study and what is known of its instance at `place`, begun or not.

    The latter as the interface shows it: see `server.store.study.evidence`.

    Raises:
        NotFoundError: there is no such study, or no such place in it.
    """
    with reading(engine) as connection:
        study = studies.find(connection, study_id)
        row, position = place
        if not (0 <= row < study.plan.rows and 0 <= position < study.plan.width):
            raise NotFoundError(
                f"study {study_id} has {study.plan.rows} rows of {study.plan.width} positions: "
                f"there is no row {row}, position {position}"
            )
        standing = evidence.standing(connection, study_id, place)
        return study, {
            **(standing or {"state": "waiting", "attempts": {}, "hosts": {}, "host_class": None}),
            "identity": study.identity,
            **evidence.around(connection, study_id, place),
        }

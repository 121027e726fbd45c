"""Have a fleet simulate the recordings of a bank: each level is a study like any other."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from rehyb.client import Client, Json
from rehyb.client.states import StudyState
from rehyb.errors import Conflict, RehybError
from rehyb.files import study_with_results

if TYPE_CHECKING:
    from analysis.interpretation.bank.bank import Bank, Samples


def sample_on_fleet(
    client: Client,
    bank: "Bank",
    *,
    rows: int,
    contact_rows: int,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> "Bank":
    """Return a bank with recordings that a coordinator's workers simulated, not yet learnt from.

    Interrupted, the studies go on, and the same call follows them again; with more rows it extends
    them.

    Args:
        client: of the coordinator.
        bank: without rows: who may come, and the seed.
        rows: wearers without contact.
        contact_rows: wearers with contact.
        progress: called with what is sampled, how many are done and how many there are.

    Raises:
        Conflict: a study was cancelled, or workers have other code than is installed here.
        InterpretationError: as `analysis.interpretation.bank.study.study_of`, or too few rows.
        RehybError: the coordinator refuses or does not answer.
    """
    from analysis.interpretation.bank.study import study_of
    from analysis.interpretation.build import check_rows

    check_rows(rows, contact_rows)
    wanted = {"bushing": rows, "contact": contact_rows}
    bodies = {
        level: study_of(bank.population, bank.seed, level, count)
        for level, count in wanted.items()
        if count
    }
    # All are submitted before the first is waited for.
    studies = {level: _study(client, body) for level, body in bodies.items()}
    found = {
        level: _sampled(client, bank, level, study, wanted[level], progress)
        for level, study in studies.items()
    }
    return replace(
        bank, fitted={}, bushing=found["bushing"], contact=found.get("contact", bank.contact)
    )


def _study(client: Client, body: Json) -> Json:
    """Return the study of a bank's level: the one that is there, extended, or a new one.

    One that other code began is left alone: workers of this code would never go on with it.
    """
    from sim.evaluation import identity

    for known in client.studies():
        same = all(known[key] == body[key] for key in ("name", "seed", "method", "model"))
        if (
            same
            and known["state"] != StudyState.CANCELLED
            and client.instance(known["id"], 0, 0)["identity"] in (None, identity())
        ):
            whole = known["rows"] >= body["rows"]
            return known if whole else client.extend(known["id"], body["rows"])
    return client.submit(body)


def _sampled(
    client: Client,
    bank: "Bank",
    level: str,
    study: Json,
    rows: int,
    progress: Callable[[str, int, int], None],
) -> "Samples":
    from analysis.interpretation.bank.study import samples_of
    from analysis.sensitivity.records import plan_of
    from rehyb.bundle.archive import in_words
    from sim.evaluation import identity

    def show(now: Json) -> None:
        progress(study["model"], now["rows_complete"], now["rows"])

    if client.wait(study["id"], on_progress=show)["state"] != StudyState.COMPLETE:
        raise Conflict(f"study {study['id']} ({study['name']}) was cancelled before it was whole")
    mine = identity()
    theirs = client.instance(study["id"], 0, 0)["identity"]
    if theirs != mine:
        raise RehybError(
            f"study {study['id']} was computed with {in_words(theirs)}, and this is "
            f"{in_words(mine)}: build the bank where its workers' version is installed"
        )
    with study_with_results(client, study["id"]) as (described, results):
        from analysis.files.results_csv import read_table

        table = read_table(plan_of(described), results)
    return samples_of(bank.population, bank.seed, level, table, rows)

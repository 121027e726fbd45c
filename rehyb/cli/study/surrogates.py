"""The command that answers by a fitted function: `study surrogate`."""

from dataclasses import asdict
from functools import partial
from typing import Any

from rehyb.cli.answers import Answer, answering
from rehyb.cli.options import Output, StudyId
from rehyb.client import Client, Json
from rehyb.errors import needs_extra, refusing
from rehyb.files import study_with_results


@answering
def surrogate(client: Client, study: StudyId, output: Output = None) -> Answer:
    """Answer by functions fitted to the runs so far, with their held-out errors.

    A Gaussian process and, with the extra `chaos`, a sparse polynomial chaos.
    """
    from analysis.files.results_csv import read_table
    from analysis.sensitivity.records import plan_of

    with study_with_results(client, study) as (described, results):
        snapshot = client.indices(study)
        with needs_extra("a surrogate", "surrogate"), refusing(ValueError):
            from analysis.sensitivity.surrogate import answer

            table = read_table(plan_of(described), results)
            found = answer(table, output or described["outputs"][0])
    return Answer(asdict(found), partial(_print, found, snapshot))


def _print(found: Any, snapshot: Json) -> None:
    from analysis.designs import family
    from rehyb.display import plain_table, statistic, whole_console

    fits = {f"{name}: S, ST": fit for name, fit in found.fits().items()}
    sampled = snapshot["outputs"][found.output]["factors"]
    names = {"first_order": "S sampled", "total_order": "ST sampled"}
    shown = names if family(snapshot["method"]) == "saltelli" else {}
    table = plain_table("factor", *fits, *shown.values())
    total = found.fit.total_order
    for factor in sorted(total, key=lambda name: -total[name]):
        table.add_row(
            factor,
            *(f"{f.first_order[factor]:.3f}, {f.total_order[factor]:.3f}" for f in fits.values()),
            *(statistic(sampled[factor].get(name)) for name in shown),
        )
    table.add_section()
    table.add_row("held out", *(f"{max(fit.held_out, 0.0):.1%} explained" for fit in fits.values()))
    console = whole_console()
    console.print(table)
    console.print(found.sentence)

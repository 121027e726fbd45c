"""One study: its indices as results arrive, how sure they are, and what its runs look like."""

from typing import Any

from fastapi import APIRouter, Request, Response
from sqlalchemy.engine import Engine

from analysis.reports import tables
from analysis.reports.figures import (
    Figure,
    bars,
    components,
    convergence,
    curve,
    interactions,
    plane,
    precision,
    together,
)
from analysis.sensitivity.judgement.stopping import advise
from analysis.sensitivity.records import curves_as_outputs
from analysis.sensitivity.remarks import remarks, warning
from analysis.sensitivity.snapshot import empty_snapshot
from models.curves import names_of as output_names
from server.errors import NotFoundError
from server.logic.study.points import for_analysis
from server.operations import models
from server.operations.study import precision_goals, studies
from server.operations.study.result_log import StoreResultLog
from server.records import Study
from server.routes.common import Id, Store
from server.web.cache import Cache
from server.web.page import Look, Page
from server.web.studies import detail
from server.web.study import sample

router = APIRouter(include_in_schema=False)

#: How outputs end that are another form of the regression (`sim.models`), and what it is called.
FORMS = {"": "affine", "_paper": "through the origin", "_authors": "the authors' own"}
#: Snapshots of studies of which nothing is known yet.
EMPTY: Cache[dict[str, Any]] = Cache(32)


def look(asked: Look) -> dict[str, Any]:
    """Return a study as it stands."""
    study = studies.get(asked.engine, asked.names["study_id"])
    goal = precision_goals.of(asked.engine, study.id)
    output, name, form = chosen(study, asked.choices, goal.output if goal else None)
    snapshot = snapshot_of(asked, study)
    units = units_of(asked.engine, study)
    unit = units.get(output, "")
    target = goal.target if goal and goal.output == output else None
    advice = advise(snapshot, output, target)
    alarm = warning(snapshot)
    return {
        "study": study,
        "detail": detail(asked, study, goal, whole=True),
        "output": output,
        "names": names_of(study),
        "name": name,
        "forms": forms_of(study, name),
        "form": form,
        "unit": unit,
        "units": units,
        "warning": alarm,
        "remarks": [said for said in remarks(snapshot, output, target) if said != alarm],
        "advice": advice,
        "goal": goal,
        "snapshot": snapshot,
        "indices": tables.indices(snapshot, output, unit),
        "pairs": tables.pairs(snapshot, output)
        if "second_order" in snapshot["outputs"][output]
        else None,
        "sampled": tables.sampled(
            [
                {"name": name, "distribution": distribution.to_json()}
                for name, distribution in study.plan.distributions.items()
            ],
            units,
        ),
        "figures": _figures(snapshot, output, unit)
        | {
            "precision": precision(snapshot, output, advice),
            "sample": {"version": sample.version(study), "output": output},
        },
    }


def _figures(snapshot: dict[str, Any], output: str, unit: str) -> dict[str, Figure | None]:
    """Return the figures that a study's report has too; None for those with nothing to show yet."""
    morris = snapshot["method"] == "morris"
    of_pairs = "second_order" in snapshot["outputs"][output]
    of_curve = output in snapshot.get("curves", {})
    drawn = {
        "bars": bars(snapshot, output, unit),
        "plane": plane(snapshot, output, unit) if morris else None,
        "convergence": convergence(snapshot, output, unit),
        "together": together(snapshot, output) if of_pairs and not of_curve else None,
        "interactions": interactions(snapshot, output) if of_pairs and not of_curve else None,
        "curve": curve(snapshot, output, unit) if of_curve else None,
        "components": components(snapshot, output, unit) if of_curve else None,
    }
    return {name: figure if figure and figure["data"] else None for name, figure in drawn.items()}


PAGE = Page(
    path="/studies/{study_id}", template="study.html", look=look, choices=("output", "form")
)


@router.get("/studies/{study_id}/sample")
def runs(study_id: Id, store: Store, request: Request) -> Response:
    """Return figures of some runs of a study, about the factor that the pointer touches."""
    study = studies.get(store, study_id)
    choices = request.query_params
    output, _, _ = chosen(study, choices, None)
    factor, other = choices.get("factor", ""), choices.get("other", "")
    units = units_of(store, study)
    content = sample.shown(store, study, output, factor, other, units)
    return Response(content, media_type="application/json", headers={"Cache-Control": "no-store"})


def chosen(study: Study, choices: Any, default: str | None) -> tuple[str, str, str]:
    """Return the output that is asked for, its name without its form, and the form."""
    outputs = _outputs(study)
    wanted = choices.get("output") or default or outputs[0]
    if wanted not in outputs and wanted not in names_of(study):
        raise NotFoundError(f"study {study.id} has no output {wanted!r}")
    name, form = _split(outputs, wanted)
    form = choices.get("form", form)
    found = name + form if name + form in outputs else wanted
    return found, name, found.removeprefix(name)


def names_of(study: Study) -> list[str]:
    """Return the outputs, those in several forms once."""
    outputs = _outputs(study)
    return list(dict.fromkeys(_split(outputs, output)[0] for output in outputs))


def forms_of(study: Study, name: str) -> list[tuple[str, str]]:
    """Return the forms that an output has."""
    return [(end, said) for end, said in FORMS.items() if name + end in _outputs(study)]


def units_of(engine: Engine, study: Study) -> dict[str, str]:
    """Return the units of a study's factors and outputs; none where the model is not known."""
    try:
        model = models.get(engine, study.plan.model).description
    except NotFoundError:
        return {}
    found = {factor.name: factor.unit for factor in model.factors} | dict(model.units)
    found |= {output.name: output.unit for output in model.results}
    return {name: "" if unit == "1" else unit for name, unit in found.items()}


def _outputs(study: Study) -> tuple[str, ...]:
    """Return the names of a study's outputs, a curve once."""
    return tuple(output_names(study.plan.outputs, study.plan.curves))


def _split(outputs: tuple[str, ...], output: str) -> tuple[str, str]:
    for end in FORMS:
        if end and output.endswith(end) and output.removesuffix(end) in outputs:
            return output.removesuffix(end), end
    return output, ""


def snapshot_of(asked: Look, study: Study) -> dict[str, Any]:
    """Return what is known of a study's indices; an empty snapshot before anything is."""
    found = StoreResultLog(asked.engine).snapshot(study.id)
    if found is None:
        # To say that nothing is known takes longer than to say what is.
        key = study.id, study.edition
        found = EMPTY.of(key, lambda: empty_snapshot(for_analysis(study)))
    return curves_as_outputs({"sampling": study.plan.sampling, **found})

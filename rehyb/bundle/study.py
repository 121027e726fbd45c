"""What study a bundle is of: its plan, its model and its results, and how to submit it again."""

from typing import TYPE_CHECKING

from rehyb.bundle.archive import Bundle
from rehyb.client import Json
from rehyb.errors import Invalid

if TYPE_CHECKING:
    from analysis.sensitivity.table import Table
    from models.description import Description
    from server.records import Plan

#: What a study of dependent factors says of them.
_DEPENDENCE = ("correlations", "correlation_kind")


def plan_of(bundle: Bundle) -> "Plan":
    """Return its study's plan, drawn up anew and checked as the coordinator would.

    Raises:
        Invalid: it is no study that this version knows.
    """
    from server.errors import InvalidStudyError
    from server.logic.study.plans import FactorChoice, draw_up

    study, model = bundle.study, model_of(bundle)
    try:
        if not 0 <= int(study["seed"]) < 2**63:
            raise ValueError(f"seed {study['seed']} is none")
        return draw_up(
            name=str(study["name"]),
            model=model,
            called=str(study["model"]),
            method=str(study["method"]),
            sampling=str(study["sampling"]),
            rows=int(study["rows"]),
            seed=int(study["seed"]),
            factors=[
                FactorChoice(name=factor["name"], distribution=factor["distribution"])
                for factor in study["factors"]
            ],
            fixed={str(name): float(value) for name, value in study["fixed"].items()},
            outputs=study["outputs"],
            # Earlier versions did not know them.
            correlations=study.get("correlations", ()),
            correlation_kind=study.get("correlation_kind", "rank"),
            groups=study.get("groups", {}),
        )
    except (InvalidStudyError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise Invalid(f"study.json describes no study that can be computed here: {error}") from None
    except KeyError as error:
        raise Invalid(f"study.json describes no study: it has no {error}") from None


def model_of(bundle: Bundle) -> "Description":
    """Return the description of a bundle's model.

    Raises:
        Invalid: it neither comes with rehyb nor is in the bundle as the study names it.
    """
    from models.built_in import built_in_models
    from models.description import Description
    from models.entries import DescriptionError

    called = str(bundle.study.get("model"))
    if called in built_in_models():
        return built_in_models()[called]
    if bundle.model is None:
        raise Invalid(
            f"study.json is of the model {called!r}, which does not come with rehyb, and there is "
            f"no model.json; known are {', '.join(built_in_models())}"
        )
    try:
        model = Description.from_json(bundle.model, kept=True)
    except DescriptionError as error:
        raise Invalid(f"model.json describes no model: {error}") from None
    if model.version != called:
        raise Invalid(f"study.json is of the model {called!r}, and model.json of {model.version}")
    return model


def request_of(study: Json) -> Json:
    """Return the request that submits the same study again."""
    asked = ("name", "model", "method", "sampling", "rows", "seed", "factors", "outputs", "fixed")
    # It was taken when it was submitted first.
    more = {name: study[name] for name in _DEPENDENCE if study.get("correlations")}
    more |= {"groups": study["groups"]} if study.get("groups") else {}
    return {**{name: study[name] for name in asked}, **more, "outside_range": True}


def table_of(bundle: Bundle) -> "Table":
    """Return its results as a table.

    Raises:
        Invalid: they cannot be read as those of its study.
    """
    from analysis.files.results_csv import read_table
    from analysis.sensitivity.records import plan_of

    try:
        return read_table(plan_of(bundle.study), bundle.results)
    except (ValueError, OverflowError, TypeError) as error:
        what = str(error).replace(str(bundle.results), "results.csv")
        raise Invalid(f"results.csv cannot be read: {what}") from None


def places_of(table: "Table") -> list[tuple[int, int]]:
    """Return the row and position of every result."""
    return list(zip(table.rows.tolist(), table.positions.tolist(), strict=True))


def lies_in(plan: "Plan", place: tuple[int, int]) -> bool:
    """Whether a study has such a row and position."""
    return 0 <= place[0] < plan.rows and 0 <= place[1] < plan.width

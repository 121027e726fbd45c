"""Nobody submits millions of instances by a slip of the finger: whoever types them is asked."""

import sys
from typing import Annotated

import typer

from rehyb.client import Client, Json
from rehyb.client.models import description_of
from rehyb.errors import Invalid, NotFound

#: Instances that nobody is asked about.
MOST = 1_000_000
#: Rows in which no model has more than that.
FEW_ROWS = 1_000
#: Of the nominal elbow on a core of 2020, and bytes of an instance in the coordinator's database
#: (docs/measurements/fleet.md).
SECONDS, BYTES = 0.4, (240, 640)

Yes = Annotated[bool, typer.Option("--yes", help=f"Do not ask about more than {MOST:,} instances.")]


def check_study(client: Client, study: Json, yes: bool) -> None:
    """Ask about a study of very many instances before it is submitted; else as `check`.

    What is wrong with a study, the coordinator says.
    """
    rows = (study["rows"], (study.get("precision") or {}).get("up_to"))
    most = max((n for n in rows if isinstance(n, int)), default=0)
    if not yes and most > FEW_ROWS:
        try:
            width = _width(study, client.model(str(study["model"])))
        except (NotFound, ValueError, TypeError, KeyError, AttributeError):
            return
        check(most * width, yes)


def check_rows(client: Client, study: str, rows: int, yes: bool) -> None:
    """Ask about `rows` rows of a study that is there if they are very many; else as `check`."""
    if not yes and rows > FEW_ROWS:
        there = client.study(study)
        check(rows * there["instances"] // there["rows"], yes)


def check(instances: int, yes: bool) -> None:
    """Ask whether so many instances are meant, if they are very many.

    Raises:
        Invalid: nobody is there to be asked.
        typer.Abort: they are not.
    """
    if yes or instances <= MOST:
        return
    days = instances * SECONDS / 86400
    low, high = (instances * each / 1e9 for each in BYTES)
    said = (
        f"that makes {instances:,} instances, of which each takes a core {SECONDS} s if it is like "
        f"the elbow's ({days:,.0f} days of one core), and in the coordinator's database {low:,.1f} "
        f"to {high:,.1f} GB in all"
    )
    if not sys.stdin.isatty():
        raise Invalid(f"{said}: if you mean it, say --yes")
    typer.confirm(f"rehyb: {said}. Is that what you want?", abort=True, err=True)


def _width(study: Json, model: Json) -> int:
    """Return how many instances a row of a study has, as the coordinator counts them."""
    from analysis.designs import row_width
    from analysis.designs.groups import units_of
    from models.factors import SEED

    description, fixed = description_of(model), study.get("fixed") or {}
    if (factors := study.get("factors")) is None:
        names = [source.name for source in description.sampled if source.name not in fixed]
    else:
        names = [factor["name"] for factor in factors]
        if not description.deterministic and SEED.name not in {*names, *fixed}:
            names.append(SEED.name)
    return row_width(study["method"], len(units_of(names, study.get("groups") or {})))

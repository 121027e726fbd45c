"""Commands about models of one's own: `model check|add|list|show`, and `umbridge serve`."""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from intake.words import counted
from rehyb.cli.answers import Answer, answering, print_line, print_rows
from rehyb.cli.options import interruptible
from rehyb.client import Client, Json
from rehyb.errors import Invalid, RehybError, refusing

if TYPE_CHECKING:
    from models.description import Description
    from models.folder import ModelFolder

app = typer.Typer(help="Models of your own.", no_args_is_help=True)
umbridge = typer.Typer(help="UM-Bridge, both ways.", no_args_is_help=True)

#: `check` looks at all corners of at most so many factors; of more, at each factor's ends.
CORNERS_OF = 5
#: Of a model with many outputs, `check` prints so many.
SHOWN = 4
#: Seconds that one evaluation may take while a model is checked.
CHECK_SECONDS = 120.0
#: How `check` calls its second look at the nominal point, which canaries of workers take, too.
AGAIN = "again, another seed"

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="A folder with model.toml.", show_default=False)
]


@app.command()
@answering
def check(
    folder: Folder,
    umbridge: Annotated[
        str | None,
        typer.Option(
            metavar="URL", help="The server, of a model of kind umbridge.", show_default=False
        ),
    ] = None,
) -> Answer:
    """Evaluate a model here, at its nominal point, twice, and at corners of its factors' ranges.

    Exit status 1 if an evaluation fails, or another seed changes what is said to be deterministic.
    """
    from models.description import Kind
    from models.evaluation import NOT_DETERMINISTIC
    from models.running.place import Place
    from models.running.pool import Pool

    read = read_model(folder)
    description = read.description
    place = Place.of(description, str(read.path), umbridge or "")
    if description.kind == Kind.UMBRIDGE:
        _check_server(read, umbridge)
    elif umbridge is not None:
        raise Invalid(
            f"--umbridge is for a model of kind umbridge: this is one of {description.kind}"
        )
    if description.kind == Kind.MJCF:
        from models.folder import ModelError
        from models.mjcf.simulate import Simulation

        with refusing(ModelError):
            Simulation(read).check_factors()
    rows = []
    pool = Pool(1, place.child_seconds or CHECK_SECONDS)
    try:
        for where, parameters in _points(description):
            seed = 2 if where == AGAIN else 1
            result = _evaluated(pool, place, parameters, seed)
            rows.append({"where": where, "parameters": parameters, **result})
    finally:
        pool.kill()
    bad = [row for row in rows if row["outcome"] != "ok"]
    faults = [*dict.fromkeys(f"{row['outcome']}: {row['reason']}" for row in bad)]
    first, again = (row["outputs"] for row in (rows[0], rows[-1]))
    # As text, since canaries tell -0.0 from 0.0.
    if description.deterministic and first and again and repr(first) != repr(again):
        faults.append(f"no worker would take it: {NOT_DETERMINISTIC}")
    return Answer(
        {
            "model": description.version,
            "evaluations": rows,
            "failed": len(bad),
            "faults": faults,
        },
        lambda: _print_check(description, rows, faults, folder),
        status=1 if faults else 0,
    )


@app.command()
@answering
def add(folder: Folder, client: Client) -> Answer:
    """Give a model to the coordinator: an mjcf model whole, any other by its description."""
    from models.description import Kind

    version = added(client, folder)
    model = client.model(version)
    runs = "every worker evaluates it"
    if model["kind"] != Kind.MJCF:
        named = f"--models {quote(str(folder))}"
        if model["kind"] == Kind.UMBRIDGE:
            named += " --umbridge URL"
        runs = f"start `rehyb-worker {named}` where it is to run"
    return Answer(model, f"{version}: {runs}")


def added(client: Client, folder: Path) -> str:
    """Give the model in a folder to the coordinator and return it as "name@digest".

    Raises:
        Invalid: it cannot be used.
    """
    from models.description import Kind
    from models.folder import pack

    read = read_model(folder)
    if read.description.kind != Kind.MJCF:
        client.announce_model(read.description.as_json())
        return read.description.version
    with tempfile.TemporaryDirectory(prefix="rehyb-model-") as scratch:
        archive = Path(scratch) / f"{read.description.name}.zip"
        pack(read, archive)
        client.add_model(archive)
    return read.description.version


@app.command("list")
@answering
def every(client: Client) -> Answer:
    """List the newest version of every model."""
    models = client.models()
    rows = [
        {
            "name": model["name"],
            "kind": "built in" if model["own"] else model["kind"],
            "digest": "" if model["own"] else model["digest"],
            "factors": len(model["factors"]),
            "description": model["description"],
        }
        for model in models
    ]
    return Answer(
        models, lambda: print_rows(("name", "kind", "digest", "factors", "description"), rows)
    )


@app.command()
@answering
def show(
    name: Annotated[str, typer.Argument(help="NAME, or NAME@DIGEST.", show_default=False)],
    client: Client,
) -> Answer:
    """Show a model's factors and outputs."""
    model = client.model(name)
    return Answer(model, lambda: _print_model(model))


@umbridge.command()
def serve(
    model: Annotated[
        list[str], typer.Option(help="A model that comes with rehyb, or a folder; repeat.")
    ],
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes any free port.")] = 4242,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Evaluations at once. Default: one per core.")
    ] = None,
) -> None:
    """Serve models to everybody who samples with an UM-Bridge client, until Ctrl-C."""
    from models.running.place import Place
    from models.running.pool import available_cores
    from models.running.queue import EvaluationQueue
    from models.umbridge.server import serve as bound

    described: dict[str, Description] = {}
    places: dict[str, Place | None] = {}
    for one in model:
        description, place = _served(one)
        described[description.name], places[description.name] = description, place
    with EvaluationQueue(processes or available_cores(), CHECK_SECONDS) as queue:
        try:
            server = bound(
                described,
                lambda name, parameters: queue.evaluate(name, places[name], parameters),
                host,
                port,
            )
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise RehybError(
                f"nobody can listen on port {port} of {host} ({why}): stop what listens "
                "there, or give another --port (0: any that is free) or --host"
            ) from None
        address, taken = server.server_address[:2]
        typer.echo(f"http://{address!s}:{taken} serves {', '.join(described)}; Ctrl-C stops it.")
        with interruptible(), server:
            server.serve_forever()


def _served(model: str) -> "tuple[Description, Any]":
    """Return a model's description, and where it is evaluated (None: it is rehyb's own)."""
    from models.built_in import built_in_models
    from models.running.place import Place

    if model in built_in_models():
        return built_in_models()[model], None
    if not Path(model).is_dir():
        raise typer.BadParameter(
            f"there is no model {model!r}: give a folder, or one of {', '.join(built_in_models())}"
        )
    read = read_model(Path(model))
    return read.description, Place.of(read.description, str(read.path))


def read_model(folder: Path) -> "ModelFolder":
    from models.built_in import built_in_models
    from models.folder import MODEL_FILE, ModelError, read_folder

    if not folder.exists():
        raise Invalid(f"{folder}: there is no such folder")
    if not (folder / MODEL_FILE).is_file() and (inner := sorted(folder.glob(f"*/{MODEL_FILE}"))):
        raise Invalid(_of_many(folder, [path.parent for path in inner]))
    with refusing(ModelError):
        read = read_folder(folder)
    if read.description.name in built_in_models():
        raise Invalid(
            f"{MODEL_FILE}: model.name: {read.description.name} is a model of rehyb's own: choose "
            "another name"
        )
    return read


def _of_many(folder: Path, inner: list[Path]) -> str:
    """Say that a folder is not a model's, but holds some, and what is wrong with which."""
    from models.folder import ModelError, read_folder

    faults = []
    for one in inner:
        try:
            read_folder(one)
        except ModelError as error:
            faults.append(f"; {one / error.file}: {error.detail}")
    return f"{folder} holds {len(inner)} models: name one of them, as {inner[0]}{''.join(faults)}"


def _check_server(folder: "ModelFolder", url: str | None) -> None:
    """Check that a server has the model of a folder, as a worker does; else Invalid."""
    from models.folder import ModelError
    from models.umbridge.client import RemoteModel, Server

    if url is None:
        raise Invalid("a model of kind umbridge needs its server: --umbridge URL")
    with refusing(ModelError):
        RemoteModel(folder, Server(url)).close()


def _points(description: "Description") -> Iterator[tuple[str, dict[str, float]]]:
    """Yield the nominal point, corners of the ranges and the nominal point, each with its name.

    In between, as in canaries, so that a program that remembers other points is noticed.
    """
    nominal = {factor.name: factor.nominal for factor in description.factors}
    yield "nominal", nominal
    yield from _corners(description, nominal)
    yield AGAIN, nominal


def _corners(
    description: "Description", nominal: Mapping[str, float]
) -> Iterator[tuple[str, dict[str, float]]]:
    from itertools import product

    if len(description.factors) <= CORNERS_OF:
        for ends in product(("low", "high"), repeat=len(description.factors)):
            yield (
                " ".join(ends),
                {
                    factor.name: float(getattr(factor, end))
                    for factor, end in zip(description.factors, ends, strict=True)
                },
            )
        return
    for factor in description.factors:
        for end in ("low", "high"):
            yield f"{factor.name} {end}", {**nominal, factor.name: float(getattr(factor, end))}


def _evaluated(pool: Any, place: Any, parameters: Mapping[str, float], seed: int) -> Json:
    instance = {"id": "check", "model": "", "parameters": parameters, "place": place, "seed": seed}
    pool.start({**instance, "time_limit": place.child_seconds}, None)
    while not (finished := pool.wait(1.0)):
        pass
    result: Json = finished[0].result
    del result["instance"]
    return result


def _print_check(
    description: "Description", rows: list[Json], faults: list[str], folder: Path
) -> None:
    factors = counted(len(description.factors), "factor", "factors")
    typer.echo(f"{description.version}: {description.kind}, {factors}")
    outputs = [output.columns[-1] for output in description.results[:SHOWN]]
    print_rows(
        ("where", "outcome", "ms", *outputs),
        [
            {
                "where": row["where"],
                "outcome": row["outcome"],
                "ms": f"{row['wall_seconds'] * 1e3:.2f}",
                **{name: f"{row['outputs'][name]:.6g}" for name in outputs if row["outputs"]},
            }
            for row in rows
        ],
    )
    for fault in faults:
        print_line(fault)
    for name in still(description, [row["outputs"] for row in rows]):
        typer.echo(f"{name} is the same at every point: nothing here moves it")
    if not faults:
        typer.echo(
            f"next: rehyb model add {quote(str(folder))}, then "
            f"rehyb study submit --model {description.name} --method saltelli --rows 256"
        )


def still(description: "Description", outputs: list[dict[str, float]]) -> list[str]:
    """Return the outputs that are the same wherever a model has an answer, at several points."""
    answers = [answer for answer in outputs if answer]
    if len(answers) <= 2:
        return []
    return [
        output.name
        for output in description.results
        if all(len({answer.get(name) for answer in answers}) == 1 for name in output.columns)
    ]


def _print_model(model: Json) -> None:
    print_line(f"{model['name']}@{model['digest']} ({model['kind']}): {model['description']}")
    print_rows(("name", "unit", "low", "nominal", "high", "description"), model["factors"])
    outputs = [{**output, "points": output["curve"] or 1} for output in model["outputs"]]
    print_rows(("name", "unit", "points"), outputs)

"""Commands about a study's files: `study export`, `bundle`, `reproduce`."""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rehyb.again import Code
from rehyb.bundle.archive import Bundle, digest_of, read_bundle, write_bundle
from rehyb.cli.answers import Answer, Token, Url, answering, file_written, study_submitted
from rehyb.cli.options import AllowedPackages, ModelFolders, Servers, StudyId, optional
from rehyb.cli.study.size import Yes
from rehyb.cli.study.size import check as ask
from rehyb.client import Client
from rehyb.files import FORMATS
from rehyb.files import export as write

if TYPE_CHECKING:
    from rehyb.bundle.reproduce import Finding


@answering
def export(
    client: Client,
    study: StudyId,
    format: Annotated[str, typer.Option(help=f"{', '.join(FORMATS)}.")] = "csv",
    out: Annotated[
        Path | None, optional(metavar="FILE", help="Default: named after the study.")
    ] = None,
) -> Answer:
    """Write a study's results so far as one file: CSV, Parquet or NetCDF."""
    return file_written(write(client, study, out, format))


@answering
def bundle(
    client: Client,
    study: StudyId,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.zip", help="Default: STUDY.zip.")
    ] = None,
) -> Answer:
    """Write a study with all that it takes to check it: results, failures, indices, versions."""
    path = out or Path(f"{study}.zip")
    digest = write_bundle(client, study, path)
    return Answer({"file": str(path), "sha256": digest}, f"{path}\nSHA-256 {digest}")


@answering
def reproduce(
    as_json: bool,
    file: Annotated[Path, typer.Argument(help="From `rehyb bundle`.", metavar="BUNDLE")],
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Check it here, without a coordinator: hashes, design, failures, indices, and a "
            "sample of its runs. Without it, the whole study is submitted again.",
        ),
    ] = False,
    sample: Annotated[int, typer.Option(min=0, help="How many runs to compute again.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Which ones.")] = 1,
    tolerance: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="How far they may be off, in standard deviations of the output over the study.",
        ),
    ] = 1e-6,
    models: ModelFolders = None,
    allow: AllowedPackages = None,
    umbridge: Servers = None,
    yes: Yes = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Check a bundle, or compute its study again. Exit status 1 if a check fails, 2 if it is none.

    Nothing of the bundle is believed, and nothing of it is written to disk under a name of its own.
    """
    from rehyb.bundle import reproduce as checks

    with tempfile.TemporaryDirectory() as folder:
        read = read_bundle(file, Path(folder))
        if not check:
            return _submitted(read, url, token, yes)
        findings = []
        code = Code(folders=models or (), packages=allow or (), servers=umbridge or ())
        for finding in checks.check(read, sample=sample, seed=seed, tolerance=tolerance, code=code):
            findings.append(finding)
            if not as_json:
                _print(finding)
    holds = all(finding.holds for finding in findings)
    answer = {
        "sha256": digest_of(file),
        "holds": holds,
        "findings": [asdict(finding) for finding in findings],
    }
    return Answer(answer, status=0 if holds else 1)


def _submitted(bundle: Bundle, url: str | None, token: str | None, yes: bool) -> Answer:
    from rehyb.bundle.study import model_of, plan_of, request_of

    ask(plan_of(bundle).instances, yes)
    with Client(url, token) as client:
        if bundle.model_archive is not None:
            client.add_model(bundle.model_archive)
        elif bundle.model is not None:
            client.announce_model(model_of(bundle).as_json())
        return study_submitted(client.submit(request_of(bundle.study)))


def _print(finding: "Finding") -> None:
    verdict = "ok    " if finding.holds else "FAILED"
    # A stranger's names must not steer the terminal.
    printable = "".join(c if c.isprintable() else "?" for c in finding.sentence)
    print(f"{verdict}  {finding.check}: {printable}", flush=True)

"""Commands about a study's files: `study export`, `bundle`, `reproduce`."""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rehyb.bundle.archive import digest_of, read_bundle, write_bundle
from rehyb.cli.options import AsJson, Token, Url, print_json
from rehyb.client import Client
from rehyb.files import FORMATS
from rehyb.files import export as write


def export(
    study: Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")],
    format: Annotated[str, typer.Option(help=f"{', '.join(FORMATS)}.")] = "csv",
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Default: named after the study.", show_default=False),
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Write a study's results so far as one file: CSV, Parquet or NetCDF."""
    with Client(url, token) as client:
        path = write(client, study, out, format)
    if as_json:
        print_json({"file": str(path)})
    else:
        typer.echo(str(path))


def bundle(
    study: Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.zip", help="Default: STUDY.zip.")
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Write a study with all that it takes to check it: results, failures, indices, versions."""
    path = out or Path(f"{study}.zip")
    with Client(url, token) as client:
        digest = write_bundle(client, study, path)
    if as_json:
        print_json({"file": str(path), "sha256": digest})
    else:
        typer.echo(f"{path}\nSHA-256 {digest}")


def reproduce(
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
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Check a bundle, or compute its study again. Exit status 1 if a check fails, 2 if it is none.

    Nothing of the bundle is believed, and nothing of it is written to disk under a name of its own.
    """
    from rehyb.bundle import reproduce as checks

    with tempfile.TemporaryDirectory() as folder:
        read = read_bundle(file, Path(folder))
        if not check:
            checks.plan_of(read.study)
            with Client(url, token) as client:
                answer = client.submit(checks.request_of(read.study))
            if as_json:
                print_json(answer)
            else:
                typer.echo(f"{answer['id']}  {answer['name']}: {answer['instances']} instances")
            return
        findings = []
        for finding in checks.check(read, sample=sample, seed=seed, tolerance=tolerance):
            findings.append(finding)
            if not as_json:
                verdict = "ok    " if finding.holds else "FAILED"
                # A stranger's names must not steer the terminal.
                said = "".join(c if c.isprintable() else "?" for c in finding.sentence)
                print(f"{verdict}  {finding.check}: {said}", flush=True)
    holds = all(finding.holds for finding in findings)
    if as_json:
        print_json(
            {
                "sha256": digest_of(file),
                "holds": holds,
                "findings": [asdict(finding) for finding in findings],
            }
        )
    if not holds:
        raise typer.Exit(1)

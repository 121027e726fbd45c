"""The command that writes a study's report: `report`."""

from pathlib import Path
from typing import Annotated

import typer

from rehyb.cli.answers import Answer, answering
from rehyb.cli.options import optional
from rehyb.client import Client
from rehyb.own_files import check_own


@answering
def report(
    client: Client,
    study: Annotated[list[str], typer.Argument(help="Ids of studies.", metavar="STUDY...")],
    out: Annotated[Path, typer.Option(metavar="FILE.html", help="The page to write.")],
    output: Annotated[
        str | None, optional(help="The output of the figures. Default: the first.")
    ] = None,
    png: Annotated[
        Path | None, optional(metavar="FOLDER", help="Also every figure as PNG.")
    ] = None,
    pdf: Annotated[
        Path | None, optional(metavar="FOLDER", help="Also every figure as PDF.")
    ] = None,
    surrogate: Annotated[
        bool,
        typer.Option("--surrogate", help="Also show what fitted functions say; takes seconds."),
    ] = False,
) -> Answer:
    """Write one HTML page, to be read offline, with every figure and table of a study."""
    check_own(out, "page")
    from rehyb.reports import report_studies

    folders = {kind: path for kind, path in (("png", png), ("pdf", pdf)) if path is not None}
    files = report_studies(client, study, out, output=output, folders=folders, surrogates=surrogate)
    names = [str(file) for file in files]
    return Answer({"files": names}, "\n".join(names))

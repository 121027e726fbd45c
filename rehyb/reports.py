"""Write the report of studies: fetch what it needs, and hand it to the analysis."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from rehyb.client import Client, Json
from rehyb.errors import Invalid, needs_extra
from rehyb.files import study_with_results
from rehyb.whole_files import whole_file


def report_studies(
    client: Client,
    ids: Sequence[str],
    out: Path,
    *,
    output: str | None,
    folders: Mapping[str, Path] | None = None,
    surrogates: bool = False,
) -> list[Path]:
    """Write one page about the studies, and return the files written.

    Args:
        ids: of the studies, in the order of their chapters.
        out: the page.
        output: shown in the figures; default: the first that the first study has.
        folders: where to write every figure too, by format: "png" or "pdf".
        surrogates: also fit functions to the runs and show their indices.

    Raises:
        Invalid: a study has no such output, or a folder is none.
        RehybError: the coordinator does not know a study, or does not answer.
    """
    for kind, folder in (folders or {}).items():
        if folder.exists() and not folder.is_dir():
            raise Invalid(f"{folder} is no folder; name one for the figures as {kind.upper()}")
    with ExitStack() as stack:
        studies = [stack.enter_context(study_with_results(client, study_id)) for study_id in ids]
        shown = output or studies[0][0]["outputs"][0]
        for study, _ in studies:
            if shown not in study["outputs"]:
                raise Invalid(
                    f"study {study['id']} has no output {shown!r}: "
                    f"it has {', '.join(study['outputs'])}"
                )
        subject = studies[0][0]["name"] if len(studies) == 1 else f"{len(studies)} studies"
        title = f"Sensitivity of {shown.replace('_', ' ')}: {subject}"
        return write(studies, shown, out, title=title, folders=folders, surrogates=surrogates)


def write(
    studies: Sequence[tuple[Json, Path]],
    output: str,
    out: Path,
    *,
    title: str,
    findings: Sequence[str] = (),
    folders: Mapping[str, Path] | None = None,
    surrogates: bool = False,
) -> list[Path]:
    """Write the page of studies whose descriptions and tables of results are at hand."""
    from analysis.reports.report import chapter, write_report

    units = {name: unit for name, unit in studies[0][0].get("units", {}).items() if unit != "1"}
    chapters = [chapter(study, table) for study, table in studies]
    with whole_file(out) as partial, needs_extra("a surrogate", "surrogate"):
        _, *pictures = write_report(
            partial,
            chapters,
            output,
            units,
            title=title,
            findings=findings,
            folders=folders,
            surrogates=surrogates,
        )
    return [out, *pictures]

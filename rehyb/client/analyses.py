"""What a client can ask a coordinator about tables of runs."""

from collections.abc import Sequence
from pathlib import Path

from rehyb.client.connection import Connection, Json, as_path, for_reading, path_of


class Analyses(Connection):
    """Indices from given samples."""

    def analyse(
        self,
        table: Path | str,
        outputs: Sequence[str] = (),
        factors: Sequence[str] | None = None,
    ) -> Json:
        """Return what a table's rows tell of its factors.

        Args:
            table: a CSV or Parquet file; nothing of it is kept.
            outputs: its columns that are outputs; a study's own table needs none named.
            factors: its columns that are factors; default: every other one that has numbers.

        Raises:
            Invalid: it cannot be analysed; the message names column and line.
        """
        path = as_path(table)
        params = {"name": path.name, "output": list(outputs), "factor": list(factors or ())}
        with for_reading(path) as file:
            return self._post("/v1/analyses", content=file, params=params)

    def analyse_study(self, study_id: str, outputs: Sequence[str] = ()) -> Json:
        """Return the same of a study's results so far; NotFound if there is no such study."""
        params = {"output": list(outputs)}
        return self._post(path_of("studies", study_id, "analyses"), params=params)

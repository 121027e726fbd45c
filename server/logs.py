"""The coordinator's log: one JSON object per line on standard error, for whoever collects logs."""

import logging
import sys

import structlog

from server.store.database.presence import is_told


def configure(level: str) -> None:
    """Send everything that is logged in this process, by whatever library, out as JSON lines.

    Of what fails since the database is away nothing is sent: that it is, is said once.
    """
    shared: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.ExtraAdder(),
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                structlog.processors.JSONRenderer(),
            ],
        )
    )
    handler.addFilter(lambda record: not (record.exc_info and is_told(record.exc_info[1])))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    # PostgreSQL's driver warns of what follows from errors that it raises anyway.
    logging.getLogger("psycopg").setLevel(logging.ERROR)

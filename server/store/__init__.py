"""The coordinator's memory, a module per noun: SQL and nothing else.

Functions work within a transaction that `server.operations` opens, take and return
`server.records`. One rule is theirs, as SQL: in which order studies are served
(`fleet.turn_statements`).
"""

from server.store.database.engine import create_engine
from server.store.database.upgrade import has_schema, require_current, upgrade

__all__ = ["create_engine", "has_schema", "require_current", "upgrade"]

"""The coordinator's memory: the only place that speaks SQL.

Every function that writes is one transaction, in which it reads, lets `server.logic` decide, and
writes what was decided.
"""

from server.store.engine import create_engine
from server.store.upgrade import require_current, upgrade

__all__ = ["create_engine", "require_current", "upgrade"]

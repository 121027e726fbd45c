"""Who works for this coordinator."""

from server.store import workers
from server.store.database.engine import alone_reading

every = alone_reading(workers.every)

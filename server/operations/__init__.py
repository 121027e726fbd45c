"""What a request does, a module per noun: read, let `server.logic` decide, write, in a transaction.

Functions that take an engine open the transaction; functions that take a connection are part of
one. `now` is in seconds, UTC epoch; `ttl` is how many seconds a lease lasts from then on.
Whoever names a study, session, job or token that is not there gets a NotFoundError.
"""

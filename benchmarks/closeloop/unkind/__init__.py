"""Closing the loop, tried by an opponent: recordings of robots under control, unkind sensors.

Nothing here uses the project's own effects or sensors. A session is drawn from a seed (`cases`,
`robots`, `faults`), simulated in MuJoCo under a controller (`laws`, `motion`, `simulate`),
recorded through a measuring chain (`chain`, `session`), answered by the product, and judged
(`judge`, `table`). `search` looks for sessions that get a wrong name and makes them small.
"""

"""Commands that print the figures README and docs quote, a folder for each part of rehyb.

`python -m benchmarks.FOLDER.NAME` runs one; `make help` lists those that are quoted most.
"""

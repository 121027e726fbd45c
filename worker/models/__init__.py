"""Which models this worker has, and how a child process evaluates each of them.

What is code runs here only because the worker's owner named it: folders (`--models`), packages
(`--allow`), servers (`--umbridge`). A model of kind `mjcf` is data, and is fetched when a study
wants it.
"""

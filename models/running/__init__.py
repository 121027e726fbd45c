"""Where each model is on this machine, and child processes that evaluate it.

What is code runs here only because this machine's owner named it. A model of kind `mjcf` is data,
and is fetched when it is wanted.
"""

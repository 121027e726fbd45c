"""The live page: what a browser shows of the coordinator while studies run.

A page is a template and a function that looks at the store. Its blocks named `live_...` are its
parts: the first answer has them all, and whoever keeps the page open is sent those that changed.
"""

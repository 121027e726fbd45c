"""Effects that a joint may have and a nominal model lacks: one class each, for every use.

A new effect is a class in the file of its family and a line in `catalogue`.
"""

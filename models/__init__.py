"""Models of one's own: what a study may sample, and how a worker evaluates it.

A model maps named factors to named outputs and says by which outcome it failed. `description` is
all that a coordinator knows of one; the other modules read, pack and evaluate the four kinds.
"""

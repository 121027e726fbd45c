"""What can be wrong with what a user gives: each is one sentence."""


class InterpretationError(ValueError):
    """A population, bank, recording or known value that cannot be used."""

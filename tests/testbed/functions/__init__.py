"""Functions of the unit cube whose indices are known."""

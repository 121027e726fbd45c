"""A study as one file, and its check."""

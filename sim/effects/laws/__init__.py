"""One class per effect, by what it is about."""

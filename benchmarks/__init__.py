"""Commands that print the figures README and docs quote: `make bench`."""

"""Indices from runs that somebody else sampled: a table with factors, outputs, and nothing more."""

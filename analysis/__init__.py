"""Designs, incremental estimators and figures of a sensitivity analysis, and its service."""

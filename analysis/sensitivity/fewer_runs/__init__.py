"""Indices from few runs: surrogates whose error is corrected and bounded by held-out runs."""

"""Indices of outputs that are curves: at every point, of the whole, and of principal components."""

"""Closing the loop with measured data: residual, trace it to an effect, add it, compare errors."""

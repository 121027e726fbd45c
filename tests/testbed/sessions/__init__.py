"""Measured sessions and recordings whose truth is known, and spoilt ones."""

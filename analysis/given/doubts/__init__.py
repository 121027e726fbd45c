"""Remarks that warn where indices of a sample mislead."""

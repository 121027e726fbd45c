"""Coordinators and their databases: one that computes on the spot, one that is full."""

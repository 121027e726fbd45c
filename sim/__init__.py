"""The arm in the exoskeleton: parameters in, one assessment out.

Knows no server, no database and no network.
"""

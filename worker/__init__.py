"""A worker: leases instances from a coordinator, evaluates them in child processes, posts results.

Knows the coordinator only through `rehyb.Client`.
"""

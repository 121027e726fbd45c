"""Estimators with intervals, when to stop, and the process that follows results."""

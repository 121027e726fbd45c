"""Decisions: pure functions of what is stored, what was asked, and the time `now`."""

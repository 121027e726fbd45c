"""Decisions: functions of what is stored, what was asked, and the time `now`.

What remembers (`Idle`, `FleetHistory`, `Failures`) does so in memory, and is told the time.
"""

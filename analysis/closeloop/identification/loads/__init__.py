"""Loads that trials carry though nobody said so, found before anything else is."""

"""Pilots: workers that a batch system starts, as many as there is work for."""

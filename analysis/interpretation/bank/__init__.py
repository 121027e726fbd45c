"""Simulated recordings of a population, and the truth behind each."""

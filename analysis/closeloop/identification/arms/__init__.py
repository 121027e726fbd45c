"""Robots of several joints: all joints in one fit, and what the joints share."""

"""Arm, exoskeleton and interface as one compiled model: how it is built, solved and started."""

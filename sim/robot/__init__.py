"""The exoskeleton: its chain of links, its controller, and how an arm is seated in it."""

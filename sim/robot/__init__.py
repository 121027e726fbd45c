"""The exoskeleton: its chain of links, its cuffs and its controller."""

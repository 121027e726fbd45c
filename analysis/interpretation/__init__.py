"""From what a robot recorded to K_h with an interval."""

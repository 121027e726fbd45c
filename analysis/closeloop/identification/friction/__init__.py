"""Friction of a robot's joints: the law it follows, at turns, when it breaks away, over speed."""

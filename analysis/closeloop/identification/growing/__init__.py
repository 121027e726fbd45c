"""Effects added one at a time, each beside those found before, and again from other starts."""

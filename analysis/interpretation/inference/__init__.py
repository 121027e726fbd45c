"""From a recording and a bank to K_h: a mean, an interval, and whether to believe it."""

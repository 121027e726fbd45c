"""Which rows of a table are taken, and whether they were drawn independently."""

"""A measured session: its files, columns, device and signals."""

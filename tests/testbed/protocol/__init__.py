"""The protocol between workers, operators and a coordinator: a model of it, and faults."""

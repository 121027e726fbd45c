"""Studies over HTTP: submitted, followed, steered, their instances and their indices."""

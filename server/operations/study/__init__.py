"""Studies, their instances and their results, from making one to running it again."""

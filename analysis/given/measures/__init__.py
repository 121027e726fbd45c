"""What a sample tells of its factors: an index a file, and their intervals."""

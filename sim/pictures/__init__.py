"""Pictures and films of one assessment."""

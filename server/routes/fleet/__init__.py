"""What workers ask for and bring over HTTP, and who they are."""

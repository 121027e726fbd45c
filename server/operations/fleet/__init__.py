"""What workers ask for and bring: alone in a transaction, or many of them in a turn."""

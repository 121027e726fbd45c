"""A user's file as columns of numbers, and why it may be refused."""

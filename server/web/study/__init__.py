"""The pages of one study, and of two beside each other."""

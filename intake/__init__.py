"""What comes from strangers is looked at here before anything else reads it."""

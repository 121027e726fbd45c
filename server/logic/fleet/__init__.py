"""Who may work on what, for how long, and what is made of what they post."""

"""What a fitted model is worth: floors of the channels, events, structure that is left, verdict."""

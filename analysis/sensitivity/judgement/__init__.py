"""What indices are worth: when to stop, what to trust, what may be fixed."""

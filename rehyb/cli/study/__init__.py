"""Commands about one study: submit and follow it, take it further, keep what it found."""

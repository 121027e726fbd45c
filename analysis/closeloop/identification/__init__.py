"""From a recording to the effects that the model lacks."""

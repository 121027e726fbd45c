"""Close-loop jobs of a worker: leased beside its instances, each in a child of its own."""

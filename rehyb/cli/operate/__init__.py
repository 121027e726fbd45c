"""Commands for whoever runs a coordinator: services, database, tokens, workers by batch."""

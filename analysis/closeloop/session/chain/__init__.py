"""The declared chain in motion: what links and loads take, also with a joint elsewhere."""

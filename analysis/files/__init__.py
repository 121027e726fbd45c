"""Files that a study's results leave in, for tools that are not ours."""

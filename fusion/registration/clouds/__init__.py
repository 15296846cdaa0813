"""Two point clouds aligned."""

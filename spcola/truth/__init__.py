"""A synthetic body, its images, and an SPC solution of it with known errors."""

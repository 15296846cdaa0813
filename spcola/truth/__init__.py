"""A synthetic body whose surface is known, and an SPC solution degraded from it."""

"""A synthetic mission: what is planted, and how well it is found again."""

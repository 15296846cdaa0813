"""Ways of being wrong, by what they alter."""

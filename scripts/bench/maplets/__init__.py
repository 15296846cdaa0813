"""Parts of the bench of maplets from images."""

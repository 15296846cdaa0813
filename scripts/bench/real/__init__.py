"""Photoclinometry on real images: missions, left-out frames, and the page of the worst and best."""

"""Mapolas registered to the SPC surface."""

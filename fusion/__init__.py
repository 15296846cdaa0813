"""Lidar and stereophotoclinometry together: registration, fused heights, scale, releases."""

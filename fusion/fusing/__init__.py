"""Fused heights: slopes of images and heights of a lidar in one integration."""

"""Readers and writers of lidar tables and point clouds."""

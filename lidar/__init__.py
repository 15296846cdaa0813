"""Altimetry alone: scans, trajectories, and the gridding of returns into mapolas."""

"""Relative weights of the points of two surfaces."""

from __future__ import annotations

BEST_SHARE = 0.1
"""Share of the points, the most accurate, that have equal weight.

A few points with far smaller sigmas than the rest, or 0, must not dominate a match.
"""

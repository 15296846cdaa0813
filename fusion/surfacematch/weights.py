"""How points of two surfaces weigh against each other."""

from __future__ import annotations

BEST_SHARE = 0.1
"""Share of the points that count alike, as known best.

A few that claim far more than the rest, or an error of 0, must not carry a match.
"""

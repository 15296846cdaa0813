"""Robust statistics: scale, weights, and their scores."""

from spcola.math.robust.weights import (
    HUBER,
    MAD_TO_SIGMA,
    TUKEY,
    Scores,
    biweight,
    biweight_scores,
    cauchy_weight,
    huber_scores,
    huber_solution,
    huber_weight,
    mad,
)

__all__ = [
    "HUBER",
    "MAD_TO_SIGMA",
    "TUKEY",
    "Scores",
    "biweight",
    "biweight_scores",
    "cauchy_weight",
    "huber_scores",
    "huber_solution",
    "huber_weight",
    "mad",
]

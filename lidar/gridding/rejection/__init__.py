"""Rejection of returns off the surface: isolated ones, and outliers of a cell."""

from lidar.gridding.rejection.outliers import RejectionOptions, find_isolated, find_outliers

__all__ = ["RejectionOptions", "find_isolated", "find_outliers"]

"""Blur, noise and transfer function: surfaces brought to one resolution."""

from fusion.surfacematch.resolution.noise import NoiseSpectrum, estimate_spectrum
from fusion.surfacematch.resolution.resolution import blur, estimate_blur
from fusion.surfacematch.resolution.transfer import Transfer, estimate_transfer

__all__ = [
    "NoiseSpectrum",
    "Transfer",
    "blur",
    "estimate_blur",
    "estimate_spectrum",
    "estimate_transfer",
]

"""Made-up but plausible contents of a report."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fusion.fusing.maplets import FusedMaplet, Source
from fusion.report.data import LidarCoverage, ReportData, Surfaces
from fusion.report.planted import RecoveredParameter
from spcola.grids import MapletGrid


def directions(count: int) -> np.ndarray:
    """Unit vectors all over the sphere, evenly."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turn = np.pi * (1 + np.sqrt(5)) * k
    rho = np.sqrt(1 - z**2)
    return np.stack([rho * np.cos(turn), rho * np.sin(turn), z], axis=1)


def terrain(rng, size: int, gsd: float) -> np.ndarray:
    """Heights, metres: rough ground, a crater, boulders."""
    rough = sum(
        0.16 * width**0.8 * ndimage.gaussian_filter(rng.normal(size=(size, size)), width)
        for width in (1.0, 2.5, 6.0, 14.0)
    )
    y, x = (np.mgrid[:size, :size] - size // 2) * gsd
    r = np.hypot(x - 4.0, y + 3.0) / 7.0
    rough += np.where(r < 1, 1.6 * (r**2 - 1) + 0.5, 0.5 * np.exp(-(((r - 1) / 0.35) ** 2)))
    for _ in range(25):
        at, radius = rng.uniform(-0.5, 0.5, 2) * size * gsd, rng.uniform(0.4, 1.6)
        inside = radius**2 - (x - at[0]) ** 2 - (y - at[1]) ** 2
        rough = rough + 0.8 * np.sqrt(np.clip(inside, 0, None))
    return rough


def surfaces(seed: int, why: str) -> Surfaces:
    rng = np.random.default_rng(seed)
    place = 250.0 * directions(40)[seed]
    usual = MapletGrid.facing(place, place, 0.35, 49)
    truth = terrain(rng, 99, 0.35)
    spc = (
        ndimage.gaussian_filter(truth, 1.6)
        + 0.2 * ndimage.gaussian_filter(rng.normal(size=truth.shape), 15) * 15
    )
    lidar = truth + rng.normal(0, 0.03, truth.shape)
    tracks = np.sin(np.arange(99) * 0.9 + seed)[None, :] + 0.2 * rng.normal(size=(99, 99)) > -0.1
    lidar[~tracks] = np.nan
    shadow = ndimage.gaussian_filter(rng.normal(size=truth.shape), 6) > 0.06
    spc[shadow] = np.nan
    height = np.where(tracks, truth, np.where(shadow, np.nan, spc - 0.02))
    source = np.where(tracks, np.where(shadow, 2, 3), np.where(shadow, 0, 1))
    gap = ndimage.binary_closing(np.isfinite(height), iterations=2) & ~np.isfinite(height)
    height[gap], source[gap] = truth[gap], Source.FILLED
    sigma = np.where(source == 3, 0.015, np.where(source == 4, 0.2, 0.06)) * rng.uniform(0.8, 1.3)
    sigma = np.where(np.isfinite(height), sigma, np.nan)
    count = np.where(tracks, rng.poisson(4.0, truth.shape), 0)
    fused = FusedMaplet(f"BE{seed:04d}", usual, height, sigma=sigma, count=count, source=source)
    return Surfaces(fused, spc, lidar, why)


def registration(count: int = 140) -> dict:
    rng = np.random.default_rng(4)
    entries = []
    for k, direction in enumerate(directions(count)):
        used = k % 17 != 3
        residual = rng.normal(0, 0.04, 3) if used else rng.normal(0, 0.3, 3)
        matched = k % 34 != 3
        entries.append({
            "name": f"BE{k:04d}", "center_m": (250 * direction).tolist(),
            "displacement_m": (residual + 0.3).tolist() if matched else [None] * 3,
            "sigma_m": [0.01, 0.01, 0.005], "used": used,
            "residual_m": residual.tolist() if matched else [None] * 3,
            "reason": "" if used else ("disagrees with the rest" if matched else "coverage < 0.3"),
            "coverage": float(rng.uniform(0.2, 1)), "correlation": float(rng.uniform(0.5, 0.99)),
        })  # fmt: skip
    return {
        "model": "similarity", "scale": 1.000213, "scale_sigma": 3.1e-5,
        "rotation_deg": [0.0012, -0.0024, 0.0105],
        "rotation_sigma_deg": [0.0011, 0.0012, 0.0009],
        "translation_m": [0.112, -0.053, 0.301], "translation_sigma_m": [0.011, 0.012, 0.009],
        "residual_std_m": [0.041, 0.039, 0.042], "n_used": 131, "n_rejected": 9,
        "per_mapola": entries,
    }  # fmt: skip


def scale() -> dict:
    rng = np.random.default_rng(6)
    pairs = []
    for k in range(260):
        longitude = float(rng.uniform(0, 360))
        pairs.append({
            "image": f"P{k:05d}", "range_m": 3500.0, "dx_m": 0.0, "dy_m": 0.0, "correlation": 0.9,
            "epsilon": 1.4e-4 + 4e-5 * np.sin(np.radians(longitude)) + rng.normal(0, 6e-5),
            "longitude_deg": longitude, "local_time_h": float(rng.uniform(9, 15)),
            "used": k % 40 != 0, "reason": "", "residual_m": 0.1,
        })  # fmt: skip
    pairs[40]["epsilon"] = 3e-3
    days = [
        {"day": f"2019-03-{7 + k:02d}", "n": 26, "epsilon": 1.4e-4 + rng.normal(0, 3e-5),
         "epsilon_sigma": 2.5e-5, "size_correction_m": 0.034}
        for k in range(10)
    ]  # fmt: skip
    return {
        "epsilon": 1.42e-4, "epsilon_sigma": 1.2e-5, "size_correction_m": 0.0348,
        "size_correction_sigma_m": 0.0029, "center_offset_m": [0.05, -0.11, None],
        "center_offset_sigma_m": [0.02, 0.03, None], "prime_meridian_deg": 0.0098,
        "prime_meridian_sigma_deg": 0.0012, "per_day": days, "per_pair": pairs,
        "reasons": ["centre offset z: all pairs lie within 20° of the equator"],
    }  # fmt: skip


@pytest.fixture(scope="session")
def places() -> tuple[Surfaces, ...]:
    return (surfaces(12, "largest lidar coverage"), surfaces(25, "most shadow"))


@pytest.fixture(scope="session")
def report_data(places) -> ReportData:
    centers = 250 * directions(140)
    share = np.random.default_rng(1).uniform(0.1, 1.0, 140)
    share[::7] = np.nan
    return ReportData(
        "Bennu <test>",
        places,
        LidarCoverage(centers, share),
        registration(),
        scale(),
        (
            RecoveredParameter("epsilon", 1.5e-4, 1.42e-4, 1.2e-5, ""),
            RecoveredParameter("rotation z", 0.01, 0.0105, 0.0009, "deg"),
            RecoveredParameter("translation x", 0.1, 0.16, 0.011, "m"),
        ),
        {"spcola": "0.1.0"},
    )

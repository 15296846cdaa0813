"""Input and options of the fusion of one maplet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from fusion.fusing.constraints import Constraints
from spcola.arrays import FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.photometry import SlopeVariance


@dataclass(frozen=True)
class FuseOptions:
    """Options of the fusion.

    Parameters
    ----------
    loss : {"l2", "huber", "cauchy"}
        Loss on the lidar heights; the robust ones limit the influence of outliers.
    loss_scale : float
        In standard deviations: residuals below it have full weight.
    step_loss_scale : float
        In standard deviations: steps of SPC that the lidar contradicts by more are down-weighted
        (Cauchy's loss).
    fraction : float
        Share of the lidar heights that is used (1: all, weighted by their uncertainty).
    seed : int
        Seed of the random subset.
    fill_sigma_m : float
        Sigma, metres, of a height that comes from the shape alone, if it cannot be estimated from
        the lidar.
    tolerance_m : float
        Largest height error of the solver, metres.
    """

    loss: Literal["l2", "huber", "cauchy"] = "huber"
    loss_scale: float = 2.0
    step_loss_scale: float = 1.0
    fraction: float = 1.0
    seed: int = 0
    fill_sigma_m: float = 1.0
    tolerance_m: float = 1e-5


@dataclass(frozen=True, eq=False)
class FuseInput:
    """Input of one fused maplet; all layers are on `grid`, heights in metres along Uz.

    Parameters
    ----------
    name : str
    grid : MapletGrid
        In SPC coordinates: the maplet's own, its centre corrected by its match.
    spc : Maplet
        The SPC maplet on that grid.
    lidar : Constraints
    prior : (2q+1, 2q+1) ndarray
        Heights of the shape model; NaN where there is none.
    common_covariance : (3, 3) ndarray
        Of the error that all lidar heights of the maplet share (registration, scans), body-fixed,
        m².
    light : SlopeVariance, optional
        Variance of the slopes from images; `spc` has no heights where images determine no slope.
    """

    name: str
    grid: MapletGrid
    spc: Maplet
    lidar: Constraints
    prior: FloatArray
    common_covariance: FloatArray
    light: SlopeVariance | None = None

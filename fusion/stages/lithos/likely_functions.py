"""Photometric functions that may be right instead of the one in use, as images show them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.stages.photometry import PHOTOMETRY_FILE
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.errors import FormatError, SettingsError
from spcola.photometry.functions import PhotometricFunction, photometric_function
from spcola.photometry.photoclinometry import PhotoclinometryOptions

__all__ = ["photometry_path", "with_likely_functions"]


def photometry_path(workspace: Workspace) -> Path | None:
    """Return what ``spcola photometry fit`` found in a solution, or else in those before it.

    Parameters
    ----------
    workspace : Workspace
        In the solution.

    Returns
    -------
    Path, optional
        None where it never was fitted.

    Raises
    ------
    WorkspaceError
        If the record of a solution cannot be read.
    """
    fitted = _fitted(workspace)
    return None if fitted is None else fitted.home / PHOTOMETRY_FILE


def _fitted(workspace: Workspace) -> Workspace | None:
    """Return the workspace in the solution in which functions were fitted."""
    name = workspace.solution
    while name:
        within = replace(workspace, solution=name)
        if (within.home / PHOTOMETRY_FILE).is_file():
            return within
        name = read_solution(workspace.root, name).parent
    return None


def with_likely_functions(
    options: PhotoclinometryOptions, workspace: Workspace
) -> PhotoclinometryOptions:
    """Return options with the functions that images do not distinguish from the one in use.

    They are equally likely. Those of another function have the parameters that were fitted; of the
    one in use, if it is as it was fitted, parameters are one sigma off along each axis of their
    covariance.

    Parameters
    ----------
    options : PhotoclinometryOptions
    workspace : Workspace
        In the parent solution.

    Raises
    ------
    FormatError
        If ``photometry.json`` lacks something.
    """
    fitted = _fitted(workspace)
    if fitted is None:
        return options
    content, used = fitted.read_json(PHOTOMETRY_FILE), options.function
    others, steps = dict[str, PhotometricFunction](), list[PhotometricFunction]()
    try:
        for entry in _as_good(content):
            function = photometric_function(entry["setting"])
            if function.name == used.name and np.allclose(
                function.values, used.values, rtol=1e-6, atol=0.0
            ):
                steps = steps or [*_steps(used, entry)]
            else:
                others[function.text] = function
    except (KeyError, TypeError, ValueError, SettingsError) as error:
        do = "fit the functions again: spcola photometry fit"
        path = fitted.home / PHOTOMETRY_FILE
        raise FormatError(f"lacks what is needed ({error!r})", path, do) from error
    share = 1.0 / (len(others) + 1.0)
    found = (*((one, share) for one in others.values()), *((one, 1.0) for one in steps))
    return replace(options, other_functions=found)


def _as_good(content: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the preferred function of each filter, and those that are as good."""
    for each in content["filters"]:
        for entry in each["functions"]:
            if entry["name"] == each["preferred"] or entry["as_good"]:
                yield entry


def _steps(used: PhotometricFunction, entry: Mapping[str, Any]) -> Iterator[PhotometricFunction]:
    """Yield a function one sigma off along each axis of the covariance of its parameters.

    Parameters that the images do not determine, whose covariance may be infinite, end at a bound.
    """
    names = list(entry["parameters"])
    if not names:
        return
    values = np.array([entry["parameters"][name]["value"] for name in names], dtype=np.float64)
    limits = {one.name: (one.lower, one.upper) for one in used.parameters}
    lower, upper = np.array([limits[name] for name in names]).T
    covariance = np.array(entry["covariance"], dtype=np.float64)
    unknown = ~np.isfinite(covariance).all(axis=0)
    covariance[unknown] = covariance[:, unknown] = 0.0
    covariance[unknown, unknown] = (upper - lower)[unknown] ** 2
    # Parameters have different units.
    unit = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    variances, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    for variance, axis in zip(variances, axes.T, strict=True):
        step = unit * np.sqrt(max(float(variance), 0.0)) * axis
        both = [np.clip(values + sign * step, lower, upper) for sign in (1.0, -1.0)]
        # A bound may be near on one side.
        farther = max(both, key=lambda moved: float(np.sum(((moved - values) / unit) ** 2)))
        yield used.having(dict(zip(names, farther.tolist(), strict=True)))

"""SPICE kernels from the solved states of a workspace."""

from __future__ import annotations

from pathlib import Path

from fusion.stages.states.source import SourceOptions, number_of, solution_spin
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.errors import KernelError
from spcola.spice.state_kernels import KernelNumbers, StateKernels, write_state_kernels

_FIRST_CAMERA = 990


def export_kernels(
    workspace: Workspace,
    settings: Settings,
    out: Path,
    *,
    options: SourceOptions,
    pck: Path | None = None,
    camera: int = 0,
    max_gap_s: float = 600.0,
) -> StateKernels:
    """Write SPK, CK and the text kernels that go with them from the .SUM files of a workspace.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    out : Path
        A new folder.
    options : SourceOptions
    pck : Path, optional
        PCK with the rotation of the solution.
    camera : int
        NAIF number of the first camera; 0: that of the spacecraft times 1000, less 990.
    max_gap_s : float
        Positions further apart, s, are not interpolated between.

    Raises
    ------
    SettingsError
        If spacecraft, body or rotation are not stated.
    KernelError
        If the folder exists, or the states read back differ.
    WorkspaceError
        If an image of the list has no .SUM file.
    InvalidValueError
        If there is no image, or two have one time.
    """
    chosen = options.completed(workspace, settings)
    chosen.check_body(workspace)
    spacecraft = number_of(chosen.spacecraft)
    first = camera or 1000 * spacecraft - _FIRST_CAMERA
    if first >= 0:
        raise KernelError("is not the number of a camera", str(first), "it is negative")
    body = _name(settings.body.name, f"BODY_{chosen.body}")
    craft = chosen.spacecraft if not _is_number(chosen.spacecraft) else f"SC{-spacecraft}"
    spin = solution_spin(workspace, settings, chosen, pck)
    about = [
        f"Solution: .SUM files of a workspace of the body {body}.",
        f"Rotation: pole {spin.pole_ra_deg:.6f} {spin.pole_dec_deg:.6f}, prime meridian",
        f"{spin.meridian_deg:.6f} deg, {spin.rate_deg_per_day:.9f} deg/day.",
    ]
    return write_state_kernels(
        out,
        workspace.images(),
        KernelNumbers(spacecraft, chosen.body, _name(craft, f"SC{-spacecraft}"), body, first),
        spin,
        max_gap_s=max_gap_s,
        radius_m=workspace.shape().mean_radius if workspace.has_shape() else 0.0,
        about=about,
    )


def _is_number(text: str) -> bool:
    """Return whether a text is a whole number."""
    return text.strip().lstrip("+-").isdigit()


def _name(text: str, otherwise: str) -> str:
    """Return a name as SPICE has it: capitals, digits and underscores."""
    kept = "".join(c if c.isalnum() and c.isascii() else "_" for c in text.upper()).strip("_")
    return kept[:32] or otherwise

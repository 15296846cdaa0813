"""Names and numbers of SPICE for the states of a workspace, and its rotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import spiceypy

from fusion.scene.geolocation import rotations
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import Settings
from spcola.errors import KernelError, SettingsError
from spcola.navigation import SPICE_LOCK, Spin
from spcola.spice import KernelSet, KernelUse, orientation_of
from spcola.spice.states import SpiceCamera, spin_of

_NO_TIMES = np.empty(0)


@dataclass(frozen=True)
class SourceOptions:
    """What names spacecraft and body where the settings do not.

    Parameters
    ----------
    kernels : tuple of Path
        Kernels to use; those of [spice] if there is none.
    prime_meridian : str
        Name of the one that gives the rotation, if several do.
    spacecraft : str
        Name or NAIF number; that of [spice] if empty.
    body : int
        NAIF number; that of [spice] if 0.
    """

    kernels: tuple[Path, ...] = ()
    prime_meridian: str = ""
    spacecraft: str = ""
    body: int = 0

    def completed(self, workspace: Workspace, settings: Settings) -> SourceOptions:
        """Return the options with the settings of [spice] where they state nothing."""
        table = settings.spice
        own = tuple(workspace.root / name for name in table.kernels)
        return SourceOptions(
            self.kernels or own,
            self.prime_meridian or ("" if self.kernels else table.prime_meridian),
            self.spacecraft or table.spacecraft,
            self.body or table.body,
        )

    def check_body(self, workspace: Workspace) -> None:
        """Refuse options without spacecraft or body.

        Raises
        ------
        SettingsError
            Which one is missing.
        """
        if self.spacecraft and self.body:
            return
        missing = "body" if self.spacecraft else "spacecraft"
        raise SettingsError(
            "must be given",
            f"{workspace.root / SETTINGS_FILE}: [spice] {missing}",
            f"or give --{missing}",
        )


@dataclass(frozen=True, eq=False)
class SpiceSource:
    """Kernels, and the camera in them.

    Parameters
    ----------
    kernels : KernelSet
    camera : SpiceCamera
    """

    kernels: KernelSet
    camera: SpiceCamera


def spice_source(
    workspace: Workspace, settings: Settings, options: SourceOptions, camera: SpiceCamera
) -> SpiceSource:
    """Return the kernels of a workspace, or those given, and the camera in them.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    options : SourceOptions
    camera : SpiceCamera
        Its spacecraft and body are replaced by those of options and settings.

    Raises
    ------
    SettingsError
        If there are no kernels, or spacecraft or body are not stated.
    KernelError
        If a kernel is missing, or several disagree about the rotation.
    """
    chosen = options.completed(workspace, settings)
    if not chosen.kernels:
        raise SettingsError(
            "holds no kernel",
            f"{workspace.root / SETTINGS_FILE}: [spice] kernels",
            "or give --kernel for each kernel or meta-kernel",
        )
    chosen.check_body(workspace)
    use = KernelUse(chosen.body, lambda: (_NO_TIMES, 0.0), "--prime-meridian")
    kernels = KernelSet(list(chosen.kernels), prime_meridian=chosen.prime_meridian or None, use=use)
    return SpiceSource(kernels, replace(camera, spacecraft=chosen.spacecraft, body=chosen.body))


def solution_spin(
    workspace: Workspace, settings: Settings, chosen: SourceOptions, pck: Path | None
) -> Spin:
    """Return the rotation with which the SPC solution of a workspace was made.

    It is that of the given PCK; else the corrected one of [spin]; else that of the kernels of
    [spice].

    Raises
    ------
    KernelError
        If a kernel states a rotation with periodic terms.
    SettingsError
        If none of them states it.
    """
    if pck is not None:
        return spin_of(pck, chosen.body)
    if settings.spin.rate_deg_per_day != 0.0:
        return rotations(settings.spin)[1]
    found = [path for path in _expanded(chosen) if chosen.body in orientation_of(path).bodies]
    if not found:
        raise SettingsError(
            "is not stated: the rotation of the body in the solution",
            f"{workspace.root / SETTINGS_FILE}: [spin]",
            "give --pck with the PCK of the solution",
        )
    return spin_of(found[-1], chosen.body)


def stated_spin(workspace: Workspace, pck: Path | None, body: int) -> Spin | None:
    """Return the rotation for states along J2000: of the given PCK, else of [spin], else none.

    Parameters
    ----------
    workspace : Workspace
    pck : Path, optional
    body : int
        NAIF number of the body in it; 0: that of [spice].

    Raises
    ------
    KernelError
        If the PCK does not state the rotation, or one with periodic terms.
    """
    settings = workspace.settings()
    if pck is None and settings.spin.rate_deg_per_day == 0.0:
        return None
    chosen = SourceOptions(body=body or settings.spice.body)
    return solution_spin(workspace, settings, chosen, pck)


def number_of(spacecraft: str) -> int:
    """Return the NAIF number of a spacecraft by name or number.

    Raises
    ------
    KernelError
        If SPICE does not know the name, or the number is not that of a spacecraft.
    """
    try:
        with SPICE_LOCK:
            number = int(spiceypy.bods2c(spacecraft))
    except spiceypy.utils.exceptions.NotFoundError:
        raise KernelError("is a name unknown to SPICE", spacecraft, "give its number") from None
    if number >= 0:
        raise KernelError("is not the number of a spacecraft", spacecraft, "it is negative")
    return number


def _expanded(chosen: SourceOptions) -> Sequence[Path]:
    """Return the kernels in the order of loading, the one chosen for the rotation last."""
    if not chosen.kernels:
        return []
    use = KernelUse(chosen.body, lambda: (_NO_TIMES, 0.0), "--pck")
    return KernelSet(
        list(chosen.kernels), prime_meridian=chosen.prime_meridian or None, use=use
    ).paths

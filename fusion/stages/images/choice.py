"""What the user chose as the source of states and cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from fusion.stages.states import SourceOptions
from spcola.spice.states import SpiceCamera


class StateKind(StrEnum):
    """Where the states of images come from."""

    NONE = ""
    POSES = "poses"
    SPICE = "spice"
    LABEL = "label"
    ISD = "isd"
    COLMAP = "colmap"


@dataclass(frozen=True, eq=False)
class StateChoice:
    """The source of states and cameras.

    Parameters
    ----------
    kind : StateKind
    path : Path, optional
        The table of poses, the folder of ISD files (that of the images if not given), or that of
        the COLMAP model.
    camera : Path, optional
        Camera file or .SUM file; needed unless the source has cameras.
    times : Path, optional
        Table of times and directions to the Sun (:func:`spcola.formats.states.read_times`).
    columns : mapping of str to str
        For names of columns, those in the table of poses.
    pck : Path, optional
        With the rotation for poses and labels along J2000.
    kernels : SourceOptions
    frame : SpiceCamera, optional
        The camera in the kernels.
    unit : {"km", "m"}
        Of the COLMAP model.
    first_pixel : float
        Coordinate of the first pixel's centre in the COLMAP model.
    """

    kind: StateKind = StateKind.NONE
    path: Path | None = None
    camera: Path | None = None
    times: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    pck: Path | None = None
    kernels: SourceOptions = field(default_factory=SourceOptions)
    frame: SpiceCamera | None = None
    unit: str = "km"
    first_pixel: float = 0.5

    @property
    def named(self) -> str:
        """The source in words."""
        return f"{self.path}" if self.path is not None else f"the files of --states {self.kind}"

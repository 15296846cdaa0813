"""``spcola align``."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.cli.options import AcceptOption, JsonOption
from fusion.cli.output import show
from spcola.errors import RejectedResultError

if TYPE_CHECKING:
    from fusion.inspection.points import PointSource
    from fusion.registration.clouds import AlignOptions

_UNIT = "Unit of the coordinates of {}, if its file states none; by default km of shapes, else m."


@dataclass(frozen=True)
class SearchOptions:
    """Which transform is searched, and how."""

    model: Annotated[
        Literal["rigid", "similarity", "affine"],
        typer.Option(help="Rotation and translation; with a scale; or any linear map."),
    ] = "similarity"
    capture: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=1e-6,
            max=1e7,
            help="Largest displacement that is searched, metres; by default a tenth of the "
            "smaller size.",
        ),
    ] = None
    gsd: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=1e-6,
            max=1e7,
            help="Step of the grids on which the two are compared, metres; by default that of "
            "their points, nodes and facets.",
        ),
    ] = None

    def chosen(self, finest_m: float) -> AlignOptions:
        """Return the options; `finest_m` is the step that the two resolve, metres."""
        from fusion.registration.clouds import AlignOptions

        return AlignOptions(self.model, self.capture or 0.0, self.gsd or finest_m)


def align(
    moving: Annotated[
        Path, typer.Argument(metavar="A", help="The cloud or surface to be moved.")
    ],
    fixed: Annotated[Path, typer.Argument(metavar="B", help="The one that it is moved onto.")],
    search: SearchOptions = SearchOptions(),
    unit_a: Annotated[
        Literal["km", "m"] | None, typer.Option("--unit-a", help=_UNIT.format("A"))
    ] = None,
    unit_b: Annotated[
        Literal["km", "m"] | None, typer.Option("--unit-b", help=_UNIT.format("B"))
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="OUT",
            help="Write A, moved onto B: a cloud as .ply, .las, .laz or .h5, a shape as .obj or "
            ".ply (an ICQ as .txt too), a maplet as .MAP. Not written if the result is refused.",
        ),
    ] = None,
    accept: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:  # fmt: skip
    """Find the transform that takes one cloud or surface to another, with its covariance.

    A and B may be lidar files, scans, clouds (PLY, PCD, LAS, LAZ, tables), maplets and bigmaps,
    terrain models, and shapes (ICQ, OBJ, PLY). A result is refused where the two show no relief in
    common at the place that was found.
    """
    # The machinery is imported here and not above, so that help comes at once.
    from fusion.inspection.points import check_target, read_points, write_moved
    from fusion.registration.clouds import align_clouds

    one, two = read_points(moving, unit=unit_a), read_points(fixed, unit=unit_b)
    if out is not None:
        check_target(one, out)
    options = search.chosen(max(one.resolution_m, two.resolution_m))
    found = align_clouds(one.points, two.points, options=options)
    obstacle = found.verdict.obstacle(accept or ())
    content = {"a": _facts(one), "b": _facts(two), **found.as_json(), "out": None}
    if out is not None and not obstacle:
        write_moved(one, found.transform, out)
        content["out"] = out
    show(content, _lines(one, two, content), as_json=as_json)
    if obstacle:
        raise RejectedResultError(f"the alignment is {obstacle}", moving)


def _facts(source: PointSource) -> dict[str, Any]:
    return {
        "path": source.path,
        "kind": source.kind,
        "points": source.count,
        "taken": len(source.points),
        "left_out": dict(source.left_out),
        "unit": source.unit,
    }


def _lines(one: PointSource, two: PointSource, content: dict[str, Any]) -> list[str]:
    """Return what people read: the transform, where it moves the ground, the verdict."""
    from fusion.estimation.verdict import verdict_lines
    from fusion.report.layout import number_text

    def row(name: str, values: Any, sigmas: Any, factor: float = 1.0) -> str:
        parts = [
            f"{number_text(factor * v, None if s is None else factor * s)} ± "
            f"{'unknown' if s is None else number_text(factor * s, factor * s)}"
            for v, s in zip(values, sigmas or [None] * len(values), strict=True)
        ]
        return f"  {name}: {', '.join(parts)}"

    head = [
        f"{one.path} ({one.kind}, {one.count} points) → {two.path} ({two.kind}, {two.count})",
        *verdict_lines(content),
    ]
    if content["translation_m"] is None:
        return head
    shift, sigma = content["shift_m"], content["shift_sigma_m"]
    lines = [
        *head,
        row("ground moved by x, y, z, m", shift, sigma.tolist()),
        row("rotation x, y, z, °", content["rotation_deg"], _listed(content["rotation_sigma_deg"])),
    ]
    if content["model"] != "rigid":
        scale_sigma = content["scale_sigma"]
        sigmas = None if scale_sigma is None else [scale_sigma]
        lines.append(row("scale − 1, 10⁻⁶", [content["scale"] - 1.0], sigmas, 1e6))
    lines.append(
        row("translation x, y, z, m", content["translation_m"],
            _listed(content["translation_sigma_m"]))
    )  # fmt: skip
    if isfinite(content["sigma_uncertainty"]):
        lines.append(
            f"  sigmas are known to {100 * content['sigma_uncertainty']:.0f} %: they come from "
            f"{content['clusters']} independent parts of the ground"
        )
    lines.append(f"  differences of height: {content['height_residual_std_m']:.3g} m")
    for source in (one, two):
        lost = ", ".join(f"{count} {reason}" for reason, count in source.left_out.items() if count)
        lines += [f"  left out of {source.path}: {lost}"] if lost else []
    return [*lines, *([str(content["out"])] if content["out"] else [])]


def _listed(values: Any) -> list[float] | None:
    return None if values is None else values.tolist()

"""What is printed of left-out frames and of albedo, and the page of the best and worst."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

import spcola
from fusion.report.layout import html_page, html_table
from real.predicted import Pair, pairs_of
from real.run import Run, Solved
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.grids import Maplet
from spcola.heights.slopes import slopes_of
from spcola.photometry.functions import photometric_function
from spcola.shape import RayCaster

_BAND = 30
_SHOWN = 10
_ENLARGED = 3


def print_left_out(
    run: Run, title: str, setting: str, solved: Solved, left_out: Sequence[SpcImage]
) -> None:
    """Print what the maplets predict for frames that were left out, and the albedo.

    Parameters
    ----------
    run : Run
    title : str
        Name of the body.
    setting : str
        Of the photometric function.
    solved : Solved
    left_out : sequence of SpcImage
        With pixels.
    """
    names = solved.names
    start, after = ({n: some.maplet(n) for n in names} for some in (solved.start, solved.after))
    if not names:
        return
    moved = [float(np.nanstd(after[n].height - start[n].height)) for n in names]
    print(f"  heights changed by {np.median(moved):.1f} m rms (median over maplets)")
    caster = RayCaster(solved.start.shape())
    begun = time.process_time()
    pairs = list(pairs_of(left_out, start, after, caster, photometric_function(setting)))
    print(f"  compared in {time.process_time() - begun:.0f} s")
    if not pairs:
        print("  no left-out frame shows a solved maplet well")
        return
    print_pairs(pairs)
    print_map(pairs)
    print_albedo(after)
    write_page(run.work / f"{title.lower()}.html", f"{title}: left-out frames", pairs)


def print_pairs(pairs: Sequence[Pair]) -> None:
    """Print what maplets predict for left-out frames, before and after."""
    start, solved = ([getattr(pair, key) for pair in pairs] for key in ("start", "solved"))
    print(f"  left-out frames: {len({pair.image for pair in pairs})}, with {len(pairs)} maplets")
    for title, values in (
        ("correlation at the state", lambda score: score.given),
        ("correlation at the best shift", lambda score: score.best),
        ("unexplained variance", lambda score: score.unexplained),
        ("residual, relative", lambda score: score.residual),
    ):
        before, after = (np.array([values(one) for one in some]) for some in (start, solved))
        better = np.mean(after > before if title.startswith("corr") else after < before)
        print(
            f"  {title:32s}{np.median(before):7.3f} → {np.median(after):.3f} (medians), "
            f"better in {better:.0%}"
        )


def print_map(pairs: Sequence[Pair]) -> None:
    """Print the gain by latitude and longitude, where there is ground."""
    print("  unexplained variance, start less solution (median, number of pairs), by place:")
    bands = [
        (south, [_at(pairs, south, west) for west in range(0, 360, _BAND)])
        for south in range(90 - _BAND, -91, -_BAND)
    ]
    wests = [k for k in range(360 // _BAND) if any(row[k] for _, row in bands)]
    print(" " * 8 + "".join(f"{_BAND * k:>11d}°" for k in wests))
    for south, row in bands:
        if any(row):
            texts = [f"{np.median(row[k]):+.2f} ({len(row[k])})" if row[k] else "–" for k in wests]
            print(f"  {south:+4d}° " + "".join(f"{text:>12s}" for text in texts))


def _at(pairs: Sequence[Pair], south: int, west: int) -> list[float]:
    """Return the gains of the maplets in a square of latitude and longitude."""
    return [
        pair.gain
        for pair in pairs
        if 0 <= pair.latitude - south < _BAND and 0 <= pair.longitude - west < _BAND
    ]


def print_albedo(maplets: Mapping[str, Maplet]) -> None:
    """Print how much albedo varies, and how much of it slopes explain."""
    spread, shares = [], []
    for maplet in maplets.values():
        slopes = np.array(slopes_of(maplet.height, maplet.grid.gsd))
        known = np.isfinite(slopes).all(axis=0) & np.isfinite(maplet.albedo)
        if np.count_nonzero(known) < 500:
            continue
        albedo = maplet.albedo[known] / maplet.albedo[known].mean() - 1.0
        # A maplet whose albedo was not solved.
        if albedo.std() < 1e-6:
            continue
        spread.append(float(albedo.std()))
        shares.append(explained(albedo, slopes[:, known]))
    print(
        f"  albedo: standard deviation {np.median(spread):.3f} (median over maplets); correlation "
        f"with slopes, both directions: {np.median(shares):.2f} (median), "
        f"{np.percentile(shares, 90):.2f} (90 %)"
    )


def explained(albedo: FloatArray, slopes: FloatArray) -> float:
    """Return the multiple correlation of albedo (N,) with both slopes (2, N)."""
    rows = np.stack([*slopes, np.ones(albedo.size)], axis=1)
    left = albedo - rows @ np.linalg.lstsq(rows, albedo, rcond=None)[0]
    return float(np.sqrt(max(1.0 - left.var() / albedo.var(), 0.0)))


def write_page(path: Path, title: str, pairs: Sequence[Pair]) -> None:
    """Write the ten best and the ten worst pairs, each with image and both predictions."""
    ordered = sorted(pairs, key=lambda pair: -pair.gain)
    sections = [
        (key, head, html_table(
            ["image", "maplet", "correlation", "left out", "start", "solution"],
            [_row(pair) for pair in some],
        ))
        for key, head, some in (
            ("best", "Best", ordered[:_SHOWN]), ("worst", "Worst", ordered[::-1][:_SHOWN]),
        )
    ]  # fmt: skip
    page = html_page(title, title, sections, {"spcola": spcola.__version__})
    path.write_text(page, encoding="utf-8")
    print(f"  page of the ten best and worst: {path}")


def _row(pair: Pair) -> list[str]:
    seen = pair.pictures[0]
    limits = [float(np.nanpercentile(seen, part)) for part in (1.0, 99.0)]
    place = f"{pair.maplet}<br>{pair.latitude:+.0f}°, {pair.longitude:.0f}°"
    scores = f"{pair.start.best:.2f} → {pair.solved.best:.2f}"
    return [pair.image, place, scores, *(_picture(one, limits) for one in pair.pictures)]


def _picture(layer: FloatArray, limits: Sequence[float]) -> str:
    large = np.repeat(np.repeat(np.nan_to_num(layer), _ENLARGED, axis=0), _ENLARGED, axis=1)
    stream = io.BytesIO()
    imsave(stream, large, cmap="gray", vmin=limits[0], vmax=limits[1], format="png")
    data = base64.b64encode(stream.getvalue()).decode()
    return f'<img style="max-width: 13rem" src="data:image/png;base64,{data}">'

"""Names of products after the convention of the altimetry working group (ALTWG)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.math import lon_lat_deg

SOURCES: Mapping[str, str] = {"SPC": "spc", "OLA": "alt", "SPO": "spo", "SFM": "sfm"}
"""DATASRC of a product → its three letters in a name; SPO is SPC and lidar together."""


def product_stem(
    grid: MapletGrid, *, version: int, source: str = "SPO", product: str = "dtm"
) -> str:
    """Return the name of a local product: ``l_{GSD}mm_{src}_{product}_{lat}{n|s}{lon}_v{NNN}``.

    The GSD is in whole millimetres (five digits or more), latitude and longitude of V are in
    hundredths of a degree, so ``5595n04217`` is 55.95° N 42.17° E.

    Raises
    ------
    InvalidValueError
        If the source or the version is invalid, or the product has other characters than
        lower-case letters and digits.
    """
    if source not in SOURCES:
        raise InvalidValueError(f"is none of {', '.join(SOURCES)}", f"source {source}")
    if not 0 <= version <= 999:
        raise InvalidValueError("is not in 0 … 999", f"version {version}")
    if not re.fullmatch(r"[a-z0-9]+", product):
        raise InvalidValueError("is not of lower-case letters and digits", f"product {product!r}")
    longitude, latitude = lon_lat_deg(grid.center)
    hundredths = round(abs(float(latitude)) * 100)
    # −0.001° is the equator, and 359.999° is the prime meridian.
    hemisphere = "s" if latitude < 0 and hundredths > 0 else "n"
    place = f"{hundredths:04d}{hemisphere}{round(float(longitude) * 100) % 36000:05d}"
    return f"l_{round(grid.gsd * 1e3):05d}mm_{SOURCES[source]}_{product}_{place}_v{version:03d}"


def product_stems(grids: Sequence[MapletGrid], *, version: int, source: str = "SPO") -> list[str]:
    """Return names of several products, no two of them equal.

    If centres agree to 0.01° and GSDs to 1 mm, the second is called ``dtm2`` and so on, in the
    given order.

    Parameters
    ----------
    grids : sequence of MapletGrid
    version : int
    source : str
        DATASRC of all.
    """
    seen: dict[str, int] = {}
    stems = []
    for grid in grids:
        first = product_stem(grid, version=version, source=source)
        seen[first] = seen.get(first, 0) + 1
        again = "dtm" if seen[first] == 1 else f"dtm{seen[first]}"
        stems.append(product_stem(grid, version=version, source=source, product=again))
    return stems

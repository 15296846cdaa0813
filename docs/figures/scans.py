"""Where returns lie, and how far scans were moved."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from spcola.math import lon_lat_deg
from fusion.report.layout import Colour, styled_figure
from fusion.workspace import Workspace
from lidar.scan_store import ScanStore

SHOWN = 20_000


def scans_figure(workspace: Workspace) -> Figure:
    """Footprints of all scans on the body, and the displacement of each by the adjustment."""
    stores = {path.stem: ScanStore([path]) for path in workspace.scan_paths()}
    with styled_figure(9.4, 4.2) as figure:
        where, moved = figure.subplots(1, 2, width_ratios=[2.2, 1.0])
        for number, (name, store) in enumerate(stores.items()):
            longitude, latitude = lon_lat_deg(store.spread(SHOWN // len(stores)))
            where.scatter(longitude, latitude, s=0.6, color=f"C{number}", label=name)
        where.set(xlim=(0, 360), ylim=(-90, 90), aspect="equal")
        where.set(xticks=range(0, 361, 60), yticks=range(-90, 91, 30))
        where.set(xlabel="east longitude, °", ylabel="latitude, °", title="Footprints of the scans")
        where.legend(markerscale=8, loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
        adjustment = workspace.adjustment()
        if adjustment is not None:
            shift = np.linalg.norm(adjustment.displacement[:, :3], axis=1)
            moved.barh(np.arange(len(shift)), 100 * shift, color=Colour.LIDAR)
            moved.set_yticks(np.arange(len(shift)), adjustment.names)
            moved.invert_yaxis()
            moved.set(xlabel="cm", title="Displacement by the adjustment")
            moved.grid(visible=True, axis="x")
    return figure

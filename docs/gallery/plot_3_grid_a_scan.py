"""
Grid a scan
===========

The returns of a lidar scan become a grid of heights: the median of the slope-corrected heights in
each cell (:doc:`/explanation/mapolas`).
"""

# %%
# Read a lidar file of any known format. Points are body-fixed, metres.
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import lidar
import spcola

mission = Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "mission"
scan = lidar.read_scan(mission / "lidar" / "scan01.dat")
print(f"{len(scan)} returns, left out: {dict(scan.rejected)}")

# %%
# A grid of 41 × 41 points, a metre apart, in the middle of the scan and facing outward.
middle = np.median(scan.points, axis=0)
grid = spcola.MapletGrid.facing(middle, middle, gsd=1.0, half_size=20)
gridding = lidar.grid_returns("MINE", grid, lidar.Returns.of_scans([scan]))
mapola, report = gridding.mapola, gridding.report
print(f"{report.used} returns used, {report.outlying + report.isolated} outliers; {report.reason}")

# %%
# Heights are metres along ``grid.uz``; cells without a return are NaN.
figure, panels = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
layers = {"height, m": mapola.height, "returns": mapola.count, "sigma, m": mapola.sigma}
for panel, (title, layer) in zip(panels, layers.items(), strict=True):
    figure.colorbar(panel.imshow(layer.T), ax=panel, shrink=0.8)
    panel.set(title=title, xticks=[], yticks=[])
plt.show()

# %%
# ``spcola.write_maplet`` writes it as a maplet (.MAP); a grid of the SPC solution is
# ``workspace.maplet(name).grid``.

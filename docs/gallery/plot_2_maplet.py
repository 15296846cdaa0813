"""
Read and plot a maplet
======================

A maplet is a square grid of heights above a plane: SPC made it from images, the lidar made a
mapola of the same form, and the fusion joined both.
"""

# %%
# The workspace of the tutorial; set the folder to your own.
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LightSource

import fusion

workspace = fusion.Workspace.open(Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "ws")
print(workspace.maplet_names()[:5], "…")

# %%
# One place, three times. Heights are metres along ``grid.uz``; unknown is NaN. Rows run along
# ``grid.uy``, columns along ``grid.ux``.
name = workspace.fused_names()[0]
maplet, mapola, fused = workspace.maplet(name), workspace.mapola(name), workspace.fused(name)
grid = fused.grid
print(
    f"{name}: centre {np.round(grid.center, 1)} m, {grid.size} points a side, {grid.gsd:g} m apart"
)

# %%
light = LightSource(azdeg=315, altdeg=45)
figure, panels = plt.subplots(1, 3, figsize=(9, 3.2), layout="constrained")
for panel, (title, one) in zip(
    panels, {"SPC": maplet, "lidar": mapola, "fused": fused}.items(), strict=True
):
    shade = light.hillshade(np.ma.masked_invalid(one.height.T), dx=grid.gsd, dy=grid.gsd)
    panel.imshow(shade, cmap="gray")
    panel.set(title=title, xticks=[], yticks=[])
plt.show()

# %%
# Heights with their sigmas, and the same points in body-fixed coordinates.
middle = grid.half_size
print(
    f"height at the centre {fused.height[middle, middle]:.3f} ± {fused.sigma[middle, middle]:.3f} m"
)
print("body-fixed, metres:", np.round(fused.points()[middle, middle], 2))

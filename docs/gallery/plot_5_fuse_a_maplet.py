"""
Fuse a maplet
=============

Slopes from images and heights from the lidar together give heights with sigmas
(:doc:`/explanation/fusing`).
"""

# %%
# A scene is a registered workspace with what the fusion needs around a maplet.
import os
from pathlib import Path

import matplotlib.pyplot as plt

import fusion

workspace = fusion.Workspace.open(Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "ws")
scene = fusion.Scene.of(workspace)

# %%
# The errors of the SPC slopes and heights, estimated by comparison with the lidar.
information = scene.information()
print(f"error of a height step between neighbours: {information.step_sigma_m:.3f} m")

# %%
# One maplet. Nothing is written.
name = scene.targets[0]
result = scene.fuse(name, information)
print(result.solution.reason)
for source in fusion.Source:
    print(f"{source.name.lower()}: {result.maplet.share(source):.0%}")

# %%
# Other options: a random tenth of the lidar heights.
sparse = scene.fuse(name, information, options=fusion.FuseOptions(fraction=0.1))
figure, panels = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
layers = {
    "fused height, m": result.maplet.height,
    "sigma, m": result.maplet.sigma,
    "sigma, a tenth of the lidar, m": sparse.maplet.sigma,
}
for panel, (title, layer) in zip(panels, layers.items(), strict=True):
    figure.colorbar(panel.imshow(layer.T), ax=panel, shrink=0.8)
    panel.set(title=title, xticks=[], yticks=[])
plt.show()

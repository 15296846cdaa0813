"""
Cast rays at a shape
====================

Where does a beam meet the body, and at which range? The same question is asked for single shots of
a lidar, for shadows and for the ground that an image shows.
"""

# %%
# The shape of the tutorial's workspace.
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fusion
import spcola

workspace = fusion.Workspace.open(Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "ws")
shape = workspace.shape()
caster = spcola.RayCaster(shape)
print(f"{len(shape.vertices)} vertices, {len(shape.facets)} facets")

# %%
# A camera 200 m out over the equator looks at the body: one ray for each pixel, all parallel.
z, y = np.mgrid[50:-50:200j, -50:50:200j]
origins = np.stack([np.full_like(y, 200.0), y, z], axis=-1).reshape(-1, 3)
hits = caster.cast(origins, np.broadcast_to([-1.0, 0.0, 0.0], origins.shape))
print(f"{hits.hit.mean():.0%} of the rays meet the body")

# %%
# Ranges are NaN where a ray misses.
plt.figure(figsize=(5, 4), layout="constrained")
plt.imshow(hits.distance.reshape(y.shape), extent=(-50, 50, -50, 50), cmap="viridis_r")
plt.colorbar(label="range, m")
plt.xlabel("y, m")
plt.ylabel("z, m")
plt.show()

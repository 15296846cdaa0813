"""
Project a landmark
==================

Where does a point of the surface lie in an image? The camera model is that of SPC: pixel (1, 1) is
the centre of the first pixel (:doc:`/reference/conventions`).
"""

# %%
# A landmark and the images in which it was measured.
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fusion
import spcola

workspace = fusion.Workspace.open(Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "ws")
landmark = workspace.landmark(workspace.landmark_names()[0])
for measured in landmark.pictures:
    image = workspace.image(measured.name)
    pixel, line = spcola.project_image(image, landmark.grid.center)
    print(
        f"{measured.name}: projected ({pixel:.2f}, {line:.2f}), "
        f"measured ({measured.pixel:.2f}, {measured.line:.2f})"
    )

# %%
# The same for all points of its maplet, coloured by height, and all landmarks of that image.
maplet = workspace.maplet(landmark.name)
pixel, line = spcola.project_image(image, maplet.points())
plt.figure(figsize=(5, 4.5), layout="constrained")
plt.pcolormesh(pixel, line, np.ma.masked_invalid(maplet.height), shading="gouraud")
plt.colorbar(label="height above the maplet's plane, m")
plt.plot([p.pixel for p in image.landmarks], [p.line for p in image.landmarks], "k+")
plt.xlabel("pixel")
plt.ylabel("line")
plt.gca().invert_yaxis()
plt.axis("equal")
plt.show()

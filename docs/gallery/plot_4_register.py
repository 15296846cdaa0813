"""
Register
========

One transform takes lidar to SPC coordinates. It is fitted to the displacements between mapolas and
maplets (:doc:`/explanation/registration`).
"""

# %%
# The stage does it all and writes ``registration.json``; here it is up to date.
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fusion

workspace = fusion.Workspace.open(Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "ws")
(done,) = fusion.run_stages(workspace, "register")
print(done.state, "-", done.summary["verdict"])

# %%
# The transform, applied to the centres of the mapolas, with the sigma of the moved positions.
known = fusion.read_registration(workspace)
print(f"scale {known.similarity.scale:.5f}, translation {known.transform.translation.round(3)} m")
mapolas = [workspace.mapola(name) for name in workspace.mapola_names()]
centers = np.array([mapola.grid.center for mapola in mapolas])
fitted = known.transform.apply(centers) - centers
sigma = np.sqrt(np.einsum("nii->ni", known.position_covariance(centers)))

# %%
# What it was fitted to: the displacement of each mapola onto the SPC surface, with its covariance.
surface = fusion.surface_reference(workspace, "maplets")
matches = [
    fusion.match_surfaces(
        mapola.name,
        mapola.grid,
        fusion.Surface(mapola.height, mapola.sigma),
        surface(mapola.name, mapola.grid),
    )
    for mapola in mapolas
]
matched = np.array([match.displacement for match in matches])
spread = np.sqrt([np.diag(match.covariance) for match in matches])

# %%
# Along z, with one standard deviation. The transform rests on all mapolas; each maplet has an error
# of its own, which the match of its mapola contains.
plt.figure(figsize=(6, 3.5), layout="constrained")
place = np.arange(len(mapolas))
plt.errorbar(
    place, matched[:, 2], spread[:, 2], fmt="o", markersize=4, label="match of each mapola"
)
plt.errorbar(place, fitted[:, 2], sigma[:, 2], fmt="k_", label="transform")
plt.ylabel("displacement along z, m")
plt.xlabel("mapola")
plt.legend()
plt.show()

"""
Align two clouds
================

The transform that takes one cloud of surface points to another, with its covariance and a verdict.
No point has to correspond to another (:doc:`/how-to/align`).
"""

# %%
# Returns of a lidar all around a body.
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fusion
import lidar
import spcola

folder = Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "mission" / "lidar"
points = np.concatenate([lidar.read_scan(path).points for path in sorted(folder.glob("*.dat"))])

# %%
# Every other return is moved by a known transform: rotated, displaced and enlarged.
planted = spcola.Similarity.from_rotation_vector(
    np.radians([0.1, -0.2, 0.1]), np.array([0.3, -0.2, 0.4]), scale=1.002
)
moving, fixed = planted.apply(points[::2]), points[1::2]

# %%
# The alignment finds the way back.
found = fusion.align_clouds(moving, fixed)
print(found.verdict.judgement, "- compared as a", found.ground)
print(f"scale {found.registration.similarity.scale:.5f}, planted {1 / planted.scale:.5f}")

# %%
# How far the moved points come to lie from where they were.
away = np.linalg.norm(found.transform.apply(moving) - points[::2], axis=1)
before = np.linalg.norm(moving - points[::2], axis=1)
print(f"median distance {np.median(before):.3f} m before, {np.median(away):.3f} m after")
plt.figure(figsize=(5, 3), layout="constrained")
plt.hist([before, away], bins=np.geomspace(1e-3, 2, 60), histtype="step", label=["before", "after"])
plt.xscale("log")
plt.xlabel("distance, m")
plt.ylabel("returns")
plt.legend()
plt.show()

"""
Open a workspace
================

A workspace is the folder in which an SPC solution, lidar scans and all results lie
(:doc:`/reference/workspace`).
"""

# %%
# The workspace of the tutorial; set the folder to your own. ``fusion.new_workspace`` makes one.
import os
from pathlib import Path

import fusion

workspace = fusion.Workspace.open(Path(os.environ.get("SPCOLA_TUTORIAL", ".")) / "ws")
for what, names in {
    "maplets": workspace.maplet_names(),
    "landmarks": workspace.landmark_names(),
    "images": workspace.image_names(),
    "scans": workspace.scan_names(),
    "fused maplets": workspace.fused_names(),
}.items():
    print(f"{len(names)} {what}: {', '.join(names[:3])}, …")

# %%
# Settings are read from ``spcola.toml``. A stage whose inputs and settings have not changed is not
# run again.
print("model of the transform:", workspace.settings().registration.model)
for done in fusion.run_stages(workspace, "mapolas", "register", "fuse"):
    print(f"{done.stage}: {done.state}")

# %%
# A picture of the workspace, or of any single file.
fusion.look_at(workspace.root)

# %%
fusion.look_at(workspace.fused_path(workspace.fused_names()[0]))

"""The report of a workspace: one self-contained page."""

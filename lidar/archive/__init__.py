"""All returns of a workspace, read by place within bounded memory."""

from lidar.archive.store import ScanStore

__all__ = ["ScanStore"]

"""All returns of a workspace, indexed by place; memory stays bounded."""

from lidar.archive.store import ScanStore

__all__ = ["ScanStore"]

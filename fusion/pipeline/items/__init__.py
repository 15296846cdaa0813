"""Items of stages: kept when they are finished, by what went into them."""

from fusion.pipeline.items.encoding import Encoded, decode, encode
from fusion.pipeline.items.item_store import ItemStore, item_folder, whole_version

__all__ = ["Encoded", "ItemStore", "decode", "encode", "item_folder", "whole_version"]

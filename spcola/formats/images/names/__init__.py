"""SPC's names of images, of at most twelve characters."""

from spcola.formats.images.names.rule import NamedImage, is_spc_name, spc_name, spc_names

__all__ = ["NamedImage", "is_spc_name", "spc_name", "spc_names"]

"""SPC's names of images, of at most twelve characters."""

from spcola.formats.images.names.rule import NamedImage, spc_name, spc_names

__all__ = ["NamedImage", "spc_name", "spc_names"]

"""SPC's names of images, of at most twelve characters."""

from spcola.formats.images.names.rule import NamedImage, spc_name, spc_names
from spcola.formats.text.source import check_name

__all__ = ["NamedImage", "check_name", "spc_name", "spc_names"]

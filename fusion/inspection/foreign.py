"""Recognise files in formats that are not read, by their first bytes."""

from __future__ import annotations

import re

_UNPACK = "unpack it first"
_BRING = "bring it into a workspace: spcola images WS FILE"
_LABEL = f"if it describes an image, {_BRING}; otherwise name the data file that it describes"
_CONVERT = "no command reads it; convert it to TIFF or FITS, which spcola images reads"
_NONE = "no command reads it"
_TABLE = (
    "if it holds lidar returns, import it: spcola import WS FILE --format F, or --format table "
    "with --columns"
)

_SIGNATURES: tuple[tuple[bytes, str, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", "a PNG image", _BRING),
    (b"\xff\xd8\xff", "a JPEG image", _CONVERT),
    (b"GIF8", "a GIF image", _CONVERT),
    (b"\x00\x00\x00\x0cjP  ", "a JPEG 2000 image", _CONVERT),
    *(
        (begin, "a TIFF", f"{_BRING}; a terrain model in GeoTIFF needs a name that ends in .tif")
        for begin in (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
    ),
    (
        b"SIMPLE  =",
        "a FITS file",
        f"an image: {_BRING}; a terrain model in FITS needs a name that ends in .fits",
    ),
    (b"CDF", "a NetCDF file", _NONE),
    (b"\x93NUMPY", "a NumPy array", _NONE),
    (
        b"SQLite format 3\x00",
        "an SQLite database",
        "name the workspace that it is the catalogue of",
    ),
    (b"PK\x03\x04", "a ZIP archive", _UNPACK),
    (b"\x1f\x8b", "a gzip file", _UNPACK),
    (b"BZh", "a bzip2 file", _UNPACK),
    (b"\xfd7zXZ\x00", "an xz file", _UNPACK),
    (b"(\xb5/\xfd", "a Zstandard file", _UNPACK),
    (b"7z\xbc\xaf'\x1c", "a 7-Zip archive", _UNPACK),
    (b"ASTM-E57", "an E57 point cloud", "convert it to LAS, PLY or PCD"),
    (b"DAS/DSK", "a SPICE DSK (binary)", "convert the shape to OBJ, with NAIF's dskexp"),
    (b"DAS/", "a SPICE kernel (binary, DAS)", _NONE),
    (b"NAIF/DA", "a SPICE kernel (binary, of before 1996)", "convert it with NAIF's bingo"),
    (b"DASETF", "a SPICE DAS kernel (transfer text)", "make it binary with NAIF's tobin"),
    (b"%PDF", "a PDF document", _NONE),
    (b"\x7fELF", "a program", _NONE),
    (
        b"LBLSIZE=",
        "a VICAR image",
        f"give its PDS label (.LBL) to spcola images; without one: {_CONVERT}",
    ),
    (b"PDS_VERSION_ID", "a PDS3 label (PVL)", _LABEL),
    (b"CCSD3ZF", "a PDS3 label (PVL)", _LABEL),
)
_ISIS_CUBE = re.compile(rb"\s*Object\s*=\s*IsisCube", re.IGNORECASE)
_PVL = re.compile(rb"\s*(?:/\*.*?\*/\s*|#[^\n]*\n\s*)*[A-Za-z^][\w:^]* *= *\S", re.DOTALL)
_XML = re.compile(rb"\s*<(?:\?xml|!doctype|[a-z_])", re.IGNORECASE)
_JSON = re.compile(rb'\s*[{\[]\s*["{\[\]}\d-]')
_MARK = b"\xef\xbb\xbf"


def name_content(head: bytes) -> tuple[str, str]:
    """Return what a file is, by its first bytes, and what to do with it.

    Parameters
    ----------
    head : bytes
        Not empty; some thousand bytes are enough.
    """
    for begin, what, advice in _SIGNATURES:
        if head.startswith(begin):
            return what, advice
    if b"\0" in head[:4096] and not _ISIS_CUBE.match(head):
        return "binary data in no format that is read", _TABLE
    return _name_text(head.removeprefix(_MARK))


def _name_text(head: bytes) -> tuple[str, str]:
    """Return what a text is, and what to do with it."""
    if _ISIS_CUBE.match(head):
        return ("an ISIS cube" if b"\0" in head else "the label of an ISIS cube (PVL)"), _BRING
    if _XML.match(head):
        if b"pds.nasa.gov/pds4" in head:
            return "a PDS4 label (XML)", _LABEL
        return ("an HTML page" if b"<html" in head.lower() else "XML"), _NONE
    if _JSON.match(head):
        return "JSON", "what SPCOLA writes in JSON has a name that ends in .json"
    if _PVL.match(head):
        return "a label or settings of the form KEY = VALUE (PVL)", _LABEL
    return "text in no format that is read", _TABLE

"""Small good images of missions: PDS3, PDS4, an ISIS cube with a table, TIFF, PNG."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import rasterio

from spcola.formats.images import open_image, read_isis_tables

LINES, SAMPLES = 12, 16
PIXELS = np.add.outer(np.arange(LINES) * 50, np.arange(SAMPLES) * 9).astype(np.uint16)

PDS3 = """PDS_VERSION_ID = PDS3\r
RECORD_TYPE = FIXED_LENGTH\r
RECORD_BYTES = 32\r
FILE_RECORDS = 52\r
^IMAGE = 41\r
PRODUCT_ID = "FRAME 1"\r
START_TIME = 2011-07-24T05:00:00.000\r
STOP_TIME = 2011-07-24T05:00:00.020\r
EXPOSURE_DURATION = 20.0 <ms>\r
DETECTOR_TEMPERATURE = (220.5 <K>, 221.5 <K>)\r
LINE_DISPLAY_DIRECTION = UP\r
SAMPLE_DISPLAY_DIRECTION = RIGHT\r
OBJECT = IMAGE\r
 LINES = 12\r
 LINE_SAMPLES = 16\r
 SAMPLE_BITS = 16\r
 SAMPLE_TYPE = MSB_UNSIGNED_INTEGER\r
 MISSING_CONSTANT = 0\r
 SCALING_FACTOR = 0.5\r
END_OBJECT = IMAGE\r
END\r
"""

PDS4 = """<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1">
 <Observation_Area>
  <Time_Coordinates>
   <start_date_time>2019-03-03T08:54:59.900Z</start_date_time>
   <stop_date_time>2019-03-03T08:54:59.950Z</stop_date_time>
  </Time_Coordinates>
  <Target_Identification><name>Bennu</name></Target_Identification>
 </Observation_Area>
 <File_Area_Observational>
  <File><file_name>a.img</file_name><file_size unit="byte">384</file_size></File>
  <Array_2D_Image>
   <offset unit="byte">0</offset>
   <axis_index_order>Last Index Fastest</axis_index_order>
   <Element_Array><data_type>UnsignedMSB2</data_type></Element_Array>
   <Axis_Array><axis_name>Line</axis_name><elements>12</elements>
    <sequence_number>1</sequence_number></Axis_Array>
   <Axis_Array><axis_name>Sample</axis_name><elements>16</elements>
    <sequence_number>2</sequence_number></Axis_Array>
   <Special_Constants><missing_constant>0</missing_constant></Special_Constants>
  </Array_2D_Image>
 </File_Area_Observational>
</Product_Observational>
"""

ISIS = """Object = IsisCube
  Object = Core
    StartByte = 2049
    Format = Tile
    TileSamples = 8
    TileLines = 8
    Group = Dimensions
      Samples = 16
      Lines = 12
      Bands = 1
    End_Group
    Group = Pixels
      Type = UnsignedWord
      ByteOrder = Lsb
      Base = 0.0
      Multiplier = 1.0
    End_Group
  End_Object
  Group = Instrument
    StartTime = 2020-03-03T21:30:31.138
    ExposureDuration = 4.2976 <ms>
  End_Group
End_Object
Object = Table
  Name = Times
  StartByte = 2561
  Bytes = 32
  Records = 2
  ByteOrder = Lsb
  Group = Field
    Name = ET
    Type = Double
    Size = 1
  End_Group
  Group = Field
    Name = Word
    Type = Text
    Size = 8
  End_Group
End_Object
End
"""


def pds3() -> bytes:
    """Return an image with an attached label."""
    return PDS3.encode().ljust(1280) + PIXELS.astype(">u2").tobytes()


def write_pds4(folder: Path) -> Path:
    """Write an image with its label; return the label."""
    (folder / "a.img").write_bytes(PIXELS.astype(">u2").tobytes())
    (folder / "a.xml").write_text(PDS4)
    return folder / "a.xml"


def isis() -> bytes:
    """Return a cube of four tiles with a table."""
    tiles = np.zeros((16, 16), "<u2")
    tiles[:LINES] = PIXELS
    core = b"".join(tiles[r : r + 8, c : c + 8].tobytes() for r in (0, 8) for c in (0, 8))
    rows = b"".join(struct.pack("<d8s", 1e8 + k, b"Latitude") for k in range(2))
    return ISIS.encode().ljust(2048, b"\0") + core + rows


def write_raster(path: Path) -> None:
    """Write a TIFF or PNG."""
    driver = "PNG" if path.suffix == ".png" else "GTiff"
    with warnings.catch_warnings(action="ignore"), rasterio.open(
        path, "w", driver=driver, count=1, height=LINES, width=SAMPLES, dtype="uint16"
    ) as dataset:  # fmt: skip
        dataset.write(PIXELS[None])


def read_image(path: Path) -> None:
    """Open an image and read all of it."""
    image = open_image(path)
    image.read()
    image.label.mid_exposure()


def read_cube(path: Path) -> None:
    """Read a cube with its tables."""
    read_image(path)
    read_isis_tables(path)

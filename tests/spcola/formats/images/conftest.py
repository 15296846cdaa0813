"""Image files of every format, written byte by byte."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from .opening import LINES, SAMPLES


@pytest.fixture
def ramp():
    """Smooth pixels (LINES, SAMPLES) from 0 to 4000."""
    line, sample = np.indices((LINES, SAMPLES))
    return (line * 90 + sample * 17).astype(np.uint16)


def card(key, value, comment=""):
    text = f"'{value:<8}'" if isinstance(value, str) else f"{value!s:>20}"
    text = {"True": "T", "False": "F"}.get(str(value), text) if isinstance(value, bool) else text
    return f"{key:<8}= {text:>20} / {comment}".ljust(80)[:80].encode()


def fits_bytes(stored, cards=()):
    """A FITS file of pixels as stored (big-endian), header written card by card."""
    bitpix = {"u1": 8, "i2": 16, "i4": 32, "f4": -32, "f8": -64}[stored.dtype.str[1:]]
    head = [
        b"SIMPLE  =                    T".ljust(80),
        card("BITPIX", bitpix),
        card("NAXIS", stored.ndim),
        *(card(f"NAXIS{n + 1}", length) for n, length in enumerate(stored.shape[::-1])),
        *(card(*entry) for entry in cards),
        b"END".ljust(80),
    ]
    header = b"".join(head)
    data = stored.tobytes()
    return header + b" " * (-len(header) % 2880) + data + b"\0" * (-len(data) % 2880)


PDS3 = """PDS_VERSION_ID = PDS3\r
RECORD_TYPE = FIXED_LENGTH\r
RECORD_BYTES = {record}\r
FILE_RECORDS = 100\r
^IMAGE = {pointer}\r
PRODUCT_ID = "FC2_00042"\r
TARGET_NAME = "4 VESTA"\r
INSTRUMENT_ID = FC2\r
FILTER_NUMBER = "1"\r
START_TIME = 2011-07-24T05:00:00.000\r
STOP_TIME = 2011-07-24T05:00:00.020\r
SPACECRAFT_CLOCK_START_COUNT = "364712345:066"\r
EXPOSURE_DURATION = {exposure}\r
DETECTOR_TEMPERATURE = 220.5 <K>\r
LINE_DISPLAY_DIRECTION = {line}\r
SAMPLE_DISPLAY_DIRECTION = RIGHT\r
OBJECT = IMAGE\r
 LINES = {lines}\r
 LINE_SAMPLES = {samples}\r
 SAMPLE_BITS = {bits}\r
 SAMPLE_TYPE = {kind}\r
{more}END_OBJECT = IMAGE\r
END\r
"""


def pds3_text(bits, kind, pointer, **changes):
    """A PDS3 label."""
    entries = {
        "record": 60, "exposure": "20.0 <ms>", "line": "UP", "lines": LINES, "samples": SAMPLES,
        "more": "",
    }  # fmt: skip
    entries |= changes
    return PDS3.format(bits=bits, kind=kind, pointer=pointer, **entries)


PDS4 = """<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1"
  xmlns:disp="http://pds.nasa.gov/pds4/disp/v1" xmlns:img="http://pds.nasa.gov/pds4/img/v1">
 <Identification_Area>
  <logical_identifier>urn:nasa:pds:mission:data:image_0042</logical_identifier>
 </Identification_Area>
 <Observation_Area>
  <Time_Coordinates>
   <start_date_time>2019-03-03T08:54:59.900Z</start_date_time>
   <stop_date_time>2019-03-03T08:54:59.950Z</stop_date_time>
  </Time_Coordinates>
  <Observing_System>
   <Observing_System_Component><name>ORX</name><type>Host</type></Observing_System_Component>
   <Observing_System_Component><name>MapCam</name><type>Instrument</type>
   </Observing_System_Component>
  </Observing_System>
  <Target_Identification><name>Bennu</name></Target_Identification>
  <Discipline_Area>
   <disp:Display_Settings><disp:Display_Direction>
     <disp:horizontal_display_axis>Sample</disp:horizontal_display_axis>
     <disp:horizontal_display_direction>{horizontal}</disp:horizontal_display_direction>
     <disp:vertical_display_axis>Line</disp:vertical_display_axis>
     <disp:vertical_display_direction>{vertical}</disp:vertical_display_direction>
   </disp:Display_Direction></disp:Display_Settings>
   <img:Imaging>
    <img:Exposure><img:exposure_duration unit="ms">50.0</img:exposure_duration></img:Exposure>
    <img:Optical_Filter><img:filter_name>PAN</img:filter_name></img:Optical_Filter>
    <img:Device_Temperature><img:device_name>CCD</img:device_name>
     <img:temperature_value unit="degC">-20.0</img:temperature_value></img:Device_Temperature>
   </img:Imaging>
  </Discipline_Area>
 </Observation_Area>
 <File_Area_Observational>
  <File><file_name>{name}</file_name><file_size unit="byte">{size}</file_size></File>
  <Array_2D_Image>
   <offset unit="byte">{offset}</offset>
   <axes>2</axes>
   <axis_index_order>Last Index Fastest</axis_index_order>
   <Element_Array><data_type>{kind}</data_type>{scaling}</Element_Array>
   <Axis_Array><axis_name>Line</axis_name><elements>{lines}</elements>
    <sequence_number>1</sequence_number></Axis_Array>
   <Axis_Array><axis_name>Sample</axis_name><elements>{samples}</elements>
    <sequence_number>2</sequence_number></Axis_Array>
   {constants}
  </Array_2D_Image>
 </File_Area_Observational>
</Product_Observational>
"""


def pds4_text(name, size, kind, **changes):
    """A PDS4 label."""
    entries = {
        "offset": 0, "lines": LINES, "samples": SAMPLES, "horizontal": "Left to Right",
        "vertical": "Bottom to Top", "scaling": "", "constants": "",
    }  # fmt: skip
    return PDS4.format(name=name, size=size, kind=kind, **(entries | changes))


ISIS = """Object = IsisCube
  Object = Core
    StartByte = 4097
    Format = {layout}
{tiles}
    Group = Dimensions
      Samples = {samples}
      Lines = {lines}
      Bands = {bands}
    End_Group
    Group = Pixels
      Type = {kind}
      ByteOrder = {order}
      Base = {base}
      Multiplier = {multiplier}
    End_Group
  End_Object
  Group = Instrument
    InstrumentId = NAVCam
    TargetName = Bennu
    StartTime = 2020-03-03T21:30:31.138
    ExposureDuration = {exposure}
    CameraTemperature = -28.5 <celsius>
  End_Group
End_Object
{tables}
End
"""


def isis_bytes(pixels, kind, *, order="Lsb", tile=None, base=0.0, multiplier=1.0, **more):
    """An ISIS cube of pixels (lines, samples) or (bands, lines, samples) in the stored type."""
    planes = pixels if pixels.ndim == 3 else pixels[None]
    bands, lines, samples = planes.shape
    stored = planes.astype(planes.dtype.newbyteorder("<" if order == "Lsb" else ">"))
    if tile is None:
        layout, tiles, data = "BandSequential", "", stored.tobytes()
    else:
        layout, (high, wide) = "Tile", tile
        tiles = f"    TileSamples = {wide}\n    TileLines = {high}"
        padded = np.zeros(
            (bands, -(-lines // high) * high, -(-samples // wide) * wide), stored.dtype
        )
        padded[:, :lines, :samples] = stored
        data = b"".join(
            padded[band, top : top + high, left : left + wide].tobytes()
            for band in range(bands)
            for top in range(0, padded.shape[1], high)
            for left in range(0, padded.shape[2], wide)
        )
    entries = {"exposure": "4.2976 <ms>", "tables": ""} | more
    label = ISIS.format(
        layout=layout, tiles=tiles, bands=bands, lines=lines, samples=samples, kind=kind,
        order=order, base=base, multiplier=multiplier, **entries,
    )  # fmt: skip
    return label.encode().ljust(4096, b"\0") + data


@pytest.fixture
def samples():
    """Functions that make the content of files."""
    return SimpleNamespace(
        fits_bytes=fits_bytes, pds3_text=pds3_text, pds4_text=pds4_text, isis_bytes=isis_bytes
    )

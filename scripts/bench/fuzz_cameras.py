"""Small good files of cameras and of star calibrations, and their readers."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from spcola.camera import Camera
from spcola.camera.instrument import FocusTable, Instrument, Pupil, ThermalFocus
from spcola.formats.cameras import read_cameras, read_isd, write_cameras
from spcola.spice.instruments import read_instrument_kernels

OCAMS = [-0.5, -0.2, 2.2e-5, 1.7e-4, 6e-5, 0.0, 0.0]
KERNEL = r"""KPL/IK
\begindata
INS-99_FOV_FRAME = 'X_CAM'
INS-99_FOCAL_LENGTH = ( 1.0D+02 )
INS-99_PIXEL_SIZE = 10
INS-99_PIXEL_SAMPLES = 200
INS-99_PIXEL_LINES = 100
INS-99_CCD_CENTER = ( 99.5, 49.5 )
INS-99_ITRANSS = ( 0, 0, 100.0 )
INS-99_ITRANSL = ( 0, -100.0, 0 )
INS-99_DISTORTION_MODEL = 'OPENCV'
INS-99_OPENCV_OD_K = ( -0.5, 0.3, -0.1, 0, 0, 0 )
INS-99_OPENCV_OD_P = ( 1E-3, 2E-3 )
INS-99_OPENCV_OD_F = ( 10010, 10020 )
INS-99_OPENCV_OD_C = ( 101, 51 )
INS-99_OPENCV_OD_A = 2.0E-5
\begintext
"""
CATALOGUE = b"# a sky\nRA,Dec,mag\n10.5,20.25,3\n11,-21,4.5\n12,22,5\n"
POSITIONS = b"image,pixel,line,sigma\nA,10.5,20.25,0.1\nA,30,40,0.2\nB,5,6,0.1\n"
ATTITUDES = b"image,ra,dec,twist,vx,vy,vz\nA,10,20,30,1,2,3\nB,11,21,31,1,2,3\n"


def isd_text() -> bytes:
    times = [45.0, 50.0, 55.0]
    content = {
        "name_model": "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL",
        "image_lines": 100, "image_samples": 200, "center_ephemeris_time": 50.0,
        "focal_length_model": {"focal_length": 100.0},
        "detector_center": {"line": 0.0, "sample": 99.5},
        "detector_sample_summing": 1, "detector_line_summing": 1,
        "starting_detector_line": 0, "starting_detector_sample": 0,
        "focal2pixel_samples": [0.0, 50.0, 0.0], "focal2pixel_lines": [0.0, 0.0, 50.0],
        "optical_distortion": {"lrolrocnac": {"coefficients": [1e-5]}},
        "line_scan_rate": [[0.5, -5.0, 0.1]],
        "body_rotation": {"reference_frame": 1, "ephemeris_times": [40.0, 60.0],
                          "quaternions": [[0.6, 0.0, 0.0, 0.8], [0.8, 0.0, 0.0, 0.6]]},
        "instrument_pointing": {"reference_frame": 1, "ephemeris_times": [40.0, 60.0],
                                "quaternions": [[0.6, 0.8, 0.0, 0.0]] * 2},
        "instrument_position": {"ephemeris_times": times,
                                "positions": [[0.0, -1010.0, 0.1 * t] for t in times],
                                "velocities": [[0.0, 0.0, 0.1]] * 3},
    }  # fmt: skip
    return json.dumps(content, indent=1).encode()


def read_line_scan(path: Path) -> None:
    read_isd(path).line_scan()


def colmap() -> bytes:
    cameras = ((1, 1, [500.0, 510.0, 320.0, 240.0]), (2, 2, [500.0, 320.0, 240.0, -0.1]))
    parts = [struct.pack("<Q", len(cameras))]
    for number, kind, values in cameras:
        parts.append(struct.pack(f"<iiQQ{len(values)}d", number, kind, 640, 480, *values))
    return b"".join(parts)


def write_camera_file(path: Path) -> None:
    camera = Camera(628.9, [513.0, 512.25], [[0, 117.6, 0], [117.6, 0.1, 1e-3]], 1024, 1000,
                    "ocams", OCAMS)  # fmt: skip
    focus = FocusTable([1.0, 2.5], [0.005, 0.0], [615.0, 628.9], [OCAMS, OCAMS])
    pupil = Pupil("POLYCAM", np.array([0.1, -0.2, 1.3]))
    write_cameras(path, [Instrument("POLYCAM", camera, ThermalFocus(20.0, 1e-5), focus, pupil)])


def read_camera_file(path: Path) -> None:
    for instrument in read_cameras(path).values():
        instrument.at(temperature_c=10.0, range_m=300.0)


def read_kernel(path: Path) -> None:
    read_instrument_kernels([path], -99)

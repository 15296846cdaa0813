"""Small clouds of points in PLY, PCD, LAS and a table."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
from fuzz_rows import (
    COUNT,
    CRAFT,
    POINTS,
    utc,
)


def table() -> bytes:
    lines = ["x_m,y_m,z_m,scx_m,scy_m,scz_m,range_m,utc,flag"]
    for index, (point, craft) in enumerate(zip(POINTS, CRAFT, strict=True)):
        values = [*point, *craft, float(np.linalg.norm(point - craft))]
        lines.append(",".join([*(repr(float(v)) for v in values), utc(index), "0"]))
    return ("\n".join(lines) + "\n").encode()


def ply_cloud(encoding: str) -> bytes:
    lines = ["ply", f"format {encoding} 1.0", "comment x", "element camera 1"]
    lines += ["property float focus", f"element vertex {COUNT}", "property uchar label"]
    lines += [f"property double {axis}" for axis in "xyz"] + ["property float intensity"]
    head = ("\n".join([*lines, "end_header"]) + "\n").encode()
    if encoding == "ascii":
        rows = [f"7 {x!r} {y!r} {z!r} 2.5\n" for x, y, z in POINTS.tolist()]
        return head + b"1.5\n" + "".join(rows).encode()
    data = b"".join(struct.pack("<Bdddf", 7, *point, 2.5) for point in POINTS)
    return head + struct.pack("<f", 1.5) + data


def pcd(data: str) -> bytes:
    header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z _ intensity\nSIZE 8 8 8 1 4\nTYPE F F F U F\n"
    header += f"COUNT 1 1 1 3 1\nWIDTH {COUNT}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {COUNT}\n"
    head = f"{header}DATA {data}\n".encode()
    if data == "ascii":
        return (
            head + "".join(f"{x!r} {y!r} {z!r} 0 0 0 2.5\n" for x, y, z in POINTS.tolist()).encode()
        )
    if data == "binary":
        return head + b"".join(struct.pack("<dddBBBf", *p, 0, 0, 0, 2.5) for p in POINTS)
    plain = b"".join(POINTS[:, axis].tobytes() for axis in range(3))
    plain += bytes(3 * COUNT) + np.full(COUNT, 2.5, "<f4").tobytes()
    parts = [plain[i : i + 32] for i in range(0, len(plain), 32)]
    packed = b"".join(bytes([len(part) - 1]) + part for part in parts)
    return head + struct.pack("<II", len(packed), len(plain)) + packed


def las(path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.zeros(3)
    file = laspy.LasData(header)
    file.x, file.y, file.z = np.tile(POINTS.T, 5)
    file.gps_time = 1e8 + np.arange(5.0 * COUNT)
    file.header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    file.write(path)

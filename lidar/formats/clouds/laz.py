"""Checks of LAZ files before the native decompressor reads them.

Points are packed in chunks; a table after them states how many bytes (and, for chunks of different
length, how many points) each has. The decompressor allocates whatever is stated, and crashes the
process if it cannot. The layout is that of LASzip's specification.
"""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

from spcola.errors import FormatError

_AGAIN = "fetch the file again"
# Writers use 50,000 points, or some more; memory is allocated for a whole chunk at once.
_USUAL_IN_CHUNK, _MOST_IN_CHUNK = 1_000_000, 10_000_000
_CHUNKED, _LAYERED = 2, 3
_FIRST_LAYERED = 10
# Number of layers of each type of item: point, colours, colours with infrared, wave packet; extra
# bytes have one each.
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}


# Errors of the decompressor for damaged points are reported by the reading that follows.
_TRIAL = """
import resource, sys
sys.path.insert(0, sys.argv[1])
import lazrs
path, packing = sys.argv[2], bytes.fromhex(sys.argv[3])
begin, left, size = map(int, sys.argv[4:])
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
hard = resource.getrlimit(resource.RLIMIT_AS)[1]
most = 1 << 33 if hard == resource.RLIM_INFINITY else min(hard, 1 << 33)
resource.setrlimit(resource.RLIMIT_AS, (most, most))
room = bytearray(size * min(left, 1_000_000))
with open(path, "rb") as stream:
    stream.seek(begin)
    decompressor = lazrs.ParLasZipDecompressor
    try:
        unpacked = decompressor(stream, packing)
        while left:
            count = min(left, 1_000_000)
            unpacked.decompress_many(memoryview(room)[: count * size])
            left -= count
    except BaseException:
        sys.exit(3)  # _TRIAL_REFUSED
"""
_TRIAL_REFUSED = 3
_TRIAL_S, _TRIAL_S_PER_MB = 60.0, 2.0


def check_chunk_table(path: Path, header: Any) -> None:
    """Refuse a LAZ file, its header by laspy, whose chunks do not make up or hold its points.

    Raises
    ------
    FormatError
        If they do not.
    """
    import lazrs  # noqa: PLC0415  (only LAZ needs it)

    size, begin = path.stat().st_size, int(header.offset_to_point_data)
    vlr = lazrs.LazVlr(header.vlrs.get("LasZipVlr")[0].record_data)
    if vlr.item_size() != header.point_format.size:
        raise _refusal(path, f"packs points of {vlr.item_size()} bytes")
    if header.point_count == 0:
        return
    with path.open("rb") as stream:
        table = _table_begin(path, stream, begin, size)
        stream.seek(table)
        head = stream.read(8)
        count = struct.unpack("<4xI", head)[0] if len(head) == 8 else 0
        # Each chunk stores its first point uncompressed.
        if not 1 <= count <= (table - begin - 8) // vlr.item_size():
            raise _refusal(path, f"promises {count} chunks of points, more than have room")
        stream.seek(table)
        chunks = lazrs.read_chunk_table_only(stream, vlr)
        _check_layers(path, stream, begin + 8, chunks, bytes(vlr.record_data()))
    points = [points for points, _ in chunks]
    if not vlr.uses_variable_size_chunks():
        chunk = vlr.chunk_size()
        points = [chunk] * (count - 1) + [header.point_count - chunk * (count - 1)]
        if not 0 < points[-1] <= chunk <= max(_USUAL_IN_CHUNK, header.point_count):
            raise _refusal(path, f"has {count} chunks of {chunk} for {header.point_count} points")
    if sum(points) != header.point_count or max(points) > _MOST_IN_CHUNK:
        raise _refusal(path, f"has {sum(points)} points in chunks of up to {max(points)}")
    packed = [there for _, there in chunks]
    if sum(packed) > table - begin - 8 or min(packed) < vlr.item_size():
        raise _refusal(path, f"has {sum(packed)} bytes in its chunks, more than are there")


def _check_layers(
    path: Path, stream: Any, begin: int, chunks: list[tuple[int, int]], record: bytes
) -> None:
    """Refuse chunks in layers (as LAS 1.4 packs its points) that state more bytes than they have.

    After its first point, uncompressed, a chunk has the number of its points and the bytes of each
    layer, four bytes each.
    """
    compressor, items = struct.unpack_from("<H30xH", record)
    kinds = struct.iter_unpack("<HHH", record[34 : 34 + 6 * items])
    sizes = [(kind, size) for kind, size, _ in kinds]
    layered = all(kind >= _FIRST_LAYERED for kind, _ in sizes)
    if compressor != (_LAYERED if layered else _CHUNKED):
        raise _refusal(path, f"is packed in way {compressor}, which does not go with its points")
    if not layered:
        return
    point = sum(size for _, size in sizes)
    layers = sum(_LAYERS.get(kind, size) for kind, size in sizes)
    for _, there in chunks:
        stream.seek(begin + point)
        head = stream.read(4 + 4 * layers)
        stated = struct.unpack(f"<4x{layers}I", head) if len(head) == 4 + 4 * layers else (there,)
        if point + len(head) + sum(stated) > there:
            raise _refusal(path, f"has a chunk of {there} bytes whose layers have {sum(stated)}")
        begin += there


def _table_begin(path: Path, stream: Any, begin: int, size: int) -> int:
    """Return where the table begins, stated before the points, or at the end by streams."""
    if size < begin + 16:
        raise _refusal(path, "has no chunk table")
    stream.seek(begin)
    table: int = struct.unpack("<q", stream.read(8))[0]
    if table == -1:
        stream.seek(size - 8)
        table = struct.unpack("<q", stream.read(8))[0]
    if not begin + 8 <= table <= size - 8:
        raise _refusal(path, f"has its chunk table at byte {table} of {size}")
    return table


def _refusal(path: Path, what: str) -> FormatError:
    return FormatError(f"{what}: it is cut off or damaged", f"{path}, chunk table", _AGAIN)


def try_decompressor(path: Path, header: Any) -> None:
    """Unpack all points of a LAZ file in a separate process, and discard them.

    The decompressor is native code, and some damaged points crash its process. Here that becomes
    an error message. It costs one more reading of the file.

    Raises
    ------
    FormatError
        If that process died, or did not end in time.
    """
    import lazrs  # noqa: PLC0415  (only LAZ needs it)

    packing = bytes(header.vlrs.get("LasZipVlr")[0].record_data)
    folder = str(Path(lazrs.__file__).resolve().parents[1])
    numbers = [int(header.offset_to_point_data), int(header.point_count)]
    words = [folder, str(path), packing.hex(), *map(str, numbers), str(header.point_format.size)]
    # Without site packages an interpreter starts in a few hundredths of a second.
    command = [sys.executable, "-I", "-S", "-c", _TRIAL, *words]
    patience = _TRIAL_S + _TRIAL_S_PER_MB * path.stat().st_size / 1e6
    try:
        code = subprocess.run(
            command,
            check=False,
            timeout=patience,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ).returncode
    except subprocess.TimeoutExpired:
        raise _refusal(path, f"takes more than {patience:.0f} s to unpack") from None
    if code < 0:
        raise _refusal(path, f"has points that bring the decompressor down (signal {-code})")
    if code not in (0, _TRIAL_REFUSED):
        raise RuntimeError(f"the trial of the decompressor ended with exit code {code}")

"""Mutations of a good file: bytes, lines, numbers, headers, structures."""

from __future__ import annotations

import io
import json
import random
import re
import struct
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

Mutation = Callable[[bytes, random.Random], bytes]

_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
NUMBERS = (
    *(
        b"nan",
        b"NaN",
        b"inf",
        b"-inf",
        b"1e999",
        b"-1e999",
        b"1e308",
        b"1e-320",
        b"0",
        b"-0",
        b"-1",
    ),
    *(b"1.5", b"255", b"256", b"32768", b"65536", b"2147483647", b"2147483648", b"4294967295"),
    *(b"4294967296", b"9223372036854775807", b"9223372036854775808", b"18446744073709551616"),
    *(b"-2147483649", b"-9223372036854775809", b"1_0", b"0x10", b"1e5", b"100000000", b"1D400"),
    *(b"9" * 400, b"9" * 5000, b"0." + b"3" * 5000, b"1e" + b"9" * 50, b"", b"x", b"****", b"1,5"),
    *("٣".encode(), "²".encode(), b"--1", b"+", b"true", b'"1"', b"[]", b"1 2", b"^", b"1^FFFFFFF"),
)
PIECES = (
    *(b"\x00", b"\x1a", b"\x0c", b"\x1c", b"\x85", b"\xff", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\n"),
    *(b"\n\n", b" ", b"\t", "\u2028".encode(), "é".encode(), b"#", b"=", b"(", b")", b"'", b'"'),
    *(b"[", b"]", b"{", b"}", b",", b";", b"\\", b"\\begindata\n", b"\\begintext\n", b"/", b"_"),
    *(b"END\n", b"nan", b"-", b"*" * 20, b"a" * 3000, b"9" * 5000, b" " * 3000, b"\n" * 3000),
)
NESTED = (b"[", b'{"a":', b"(", b"'", b"a.", b"-", b"1", b"a", b"0 ", b"\n", b"x=")
_INTEGERS = (0, 1, -1, 2, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40,
             2**62, 2**63 - 1, 2**63, 2**64 - 1)  # fmt: skip
_REALS = (0.0, -0.0, 1.0, -1.0, 1e-320, 1e-30, 1e30, 1e300, float("inf"), float("-inf"),
          float("nan"))  # fmt: skip


def mutated(content: bytes, form: str, random_: random.Random) -> bytes:
    """Return `content` with one to three mutations that fit its form."""
    # Most files are damaged only once: several errors hide each other.
    ways = [random_.choice(_WAYS[form]) for _ in range(random_.choice((1, 1, 1, 2, 3)))]
    # A structure is changed by a library, which needs a whole file.
    for way in sorted(ways, key=lambda way: way is not structure):
        content = way(content, random_)
    return content


def _place(content: bytes, random_: random.Random) -> int:
    """Return a place in the file, in half of the cases in its first part."""
    end = min(len(content), 512) if random_.random() < 0.5 else len(content)
    return random_.randrange(end) if end else 0


def flip(content: bytes, random_: random.Random) -> bytes:
    """Flip some bits."""
    if not content:
        return content
    changed = bytearray(content)
    for _ in range(random_.choice((1, 1, 2, 8))):
        changed[_place(content, random_)] ^= 1 << random_.randrange(8)
    return bytes(changed)


def overwrite(content: bytes, random_: random.Random) -> bytes:
    """Write an absurd number over some bytes, in either byte order."""
    order, size = random_.choice("<>"), random_.choice((1, 2, 4, 8))
    if random_.random() < 0.7 or size < 4:
        value = random_.choice(_INTEGERS) % (1 << 8 * size)
        patch = value.to_bytes(size, "little" if order == "<" else "big")
    else:
        with np.errstate(all="ignore"):
            patch = np.array(random_.choice(_REALS), f"{order}f{size}").tobytes()
    at = _place(content + b"\0", random_)
    at -= at % size if random_.random() < 0.5 else 0
    return content[:at] + patch + content[at + size :]


def cut(content: bytes, random_: random.Random) -> bytes:
    """Cut the file off: anywhere, near an end, or at a boundary of lines, words or records."""
    at = random_.choice(
        (
            _place(content + b"\0", random_),
            max(len(content) - random_.randrange(1, 40), 0),
            random_.randrange(40),
            len(content) - len(content) % random_.choice((8, 72, 80, 186, 256, 1024, 2880)),
            content.rfind(b"\n", 0, _place(content + b"\0", random_)) + random_.choice((0, 1)),
        )
    )
    return content[:at]


def remove(content: bytes, random_: random.Random) -> bytes:
    """Remove a span."""
    at = _place(content + b"\0", random_)
    return content[:at] + content[at + random_.choice((1, 2, 4, 8, 80, 1024)) :]


def insert(content: bytes, random_: random.Random) -> bytes:
    """Insert a piece, or another part of the file; or put it behind the end."""
    at = random_.choice((_place(content + b"\0", random_), len(content)))
    begin = _place(content + b"\0", random_)
    piece = random_.choice(
        (random_.choice(PIECES), content[begin : begin + random_.choice((1, 8, 80, 1024))])
    )
    return content[:at] + piece + content[at:]


def blank(content: bytes, random_: random.Random) -> bytes:
    """Fill a span with one byte."""
    at, size = _place(content + b"\0", random_), random_.choice((1, 4, 8, 64, 512))
    return content[:at] + random_.choice((b"\0", b"\xff", b" ")) * size + content[at + size :]


def number(content: bytes, random_: random.Random) -> bytes:
    """Replace a number of a text by an absurd one."""
    found = list(_NUMBER.finditer(content))
    if not found:
        return content
    first = found[: max(len(found) // 8, 12)]
    one = random_.choice(first if random_.random() < 0.5 else found)
    return content[: one.start()] + random_.choice(NUMBERS) + content[one.end() :]


def word(content: bytes, random_: random.Random) -> bytes:
    """Replace a word of a text by another one of it, or by something else."""
    found = list(_WORD.finditer(content))
    if not found:
        return content
    one, other = random_.choice(found), random_.choice(found)
    new = random_.choice((other.group(), other.group().swapcase(), *random_.sample(NUMBERS, 2)))
    return content[: one.start()] + new + content[one.end() :]


def lines(content: bytes, random_: random.Random) -> bytes:
    """Remove, repeat, exchange, join or empty lines, or end them in another way."""
    rows = content.split(b"\n")
    one, other = random_.randrange(len(rows)), random_.randrange(len(rows))
    way = random_.randrange(7)
    if way == 0:
        del rows[one]
    elif way == 1:
        rows[one:one] = [rows[other]] * random_.choice((1, 1, 2, 300))
    elif way == 2:
        rows[one], rows[other] = rows[other], rows[one]
    elif way == 3:
        rows[one] = b""
    elif way == 4:
        rows[one] = rows[one][: random_.randrange(len(rows[one]) + 1)]
    elif way == 5:
        return random_.choice((b"\r\n", b"\r", b"\n\n", b" ", b"\x1a\n")).join(rows)
    else:
        return b"\n".join(rows) + random_.choice(
            (b"\x1a", b"\x00", b"\n\x1a", b" ", b"\n \n", b"x")
        )
    return b"\n".join(rows)


def flood(content: bytes, random_: random.Random) -> bytes:
    """Put thousands of one thing somewhere: nesting, a long word, blank lines."""
    if random_.random() < 0.9:  # large, hence slow: a tenth is enough
        return number(content, random_)
    at = random_.choice((0, _place(content + b"\0", random_), len(content)))
    flooded = random_.choice(NESTED) * random_.choice((1000, 50_000))
    return content[:at] + flooded + content[at:]


def leaf(content: bytes, random_: random.Random) -> bytes:
    """Replace, rename, repeat or remove one entry of a JSON text."""
    try:
        whole = json.loads(content)
    except (ValueError, RecursionError):
        return flip(content, random_)
    node = whole
    while isinstance(node, dict | list) and node:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key: Any = random_.choice(keys)
        below = node[key]
        if isinstance(below, dict | list) and below and random_.random() < 0.7:
            node = below
            continue
        if isinstance(node, dict) and random_.random() < 0.2:
            node[random_.choice(("", "x", "name", "__class__"))] = node.pop(key)
        elif random_.random() < 0.15:
            del node[key]
        else:
            node[key] = random_.choice(
                (None, True, [], {}, "", "x", [[]], {"a": 1}, -1, 0, 1e308, 10**400, 2**63, 0.5,
                 float("nan"), float("inf"), "nan", [1], [1, 2, 3], [None] * 3, [["x"]], "\ud800")
            )  # fmt: skip
        break
    return json.dumps(whole).encode("utf-8", errors="surrogatepass")


def card(content: bytes, random_: random.Random) -> bytes:
    """Replace the value of a FITS card, at its place."""
    cards = [at for at in range(0, len(content) - 80, 80) if content[at + 8 : at + 10] == b"= "]
    if not cards:
        return flip(content, random_)
    at = random_.choice(cards)
    value = random_.choice((*NUMBERS, b"'text'", b"T", b"F", b"'", b"(1, 2)"))[:68].rjust(20)
    return content[: at + 10] + value[:70].ljust(70) + content[at + 80 :]


def header_word(content: bytes, random_: random.Random) -> bytes:
    """Write an absurd number over an aligned word of the first 600 bytes, or near a LAZ chunk."""
    size = random_.choice((1, 2, 4, 8))
    begin = 0
    if content[:4] == b"LASF" and len(content) > 375:
        begin = random_.choice((0, 94, 100, 235, 375, struct.unpack_from("<I", content, 96)[0]))
        table = struct.unpack_from("<q", content, begin)[0] if begin + 8 < len(content) else 0
        begin = random_.choice((begin, table if 0 < table < len(content) else begin))
    at = begin + random_.randrange(0, 160, size) if begin else random_.randrange(0, 600, size)
    value = random_.choice(_INTEGERS) % (1 << 8 * size)
    return content[:at] + value.to_bytes(size, "little") + content[at + size :]


_VALUES: tuple[Any, ...] = (
    *(0, 1, -1, 2**31, 2**62, 1e308, float("nan"), float("inf"), 1e-320, "", "x", "nan", b"\xff"),
    *([], [1.0], [1, 2, 3], [[1.0]], "[1]", "{", "null", "[" * 3000, '{"a": 1}', True),
    *(np.zeros((3, 3)), np.full(3, np.nan), np.zeros(0), np.uint8(255), h5py.Empty("f8")),
)


def structure(content: bytes, random_: random.Random) -> bytes:
    """Give an HDF5 file other attributes, datasets, groups or links."""
    image = io.BytesIO(content)
    try:
        with h5py.File(image, "r+") as file:
            found = [file]
            file.visititems(lambda _, node: found.append(node))
            node = random_.choice(found)
            if node.attrs and random_.random() < 0.5:
                _other_attribute(node, random_)
            elif node is not file:
                _other_node(file, node, random_)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError):
        return flip(content, random_)  # it was damaged before, or takes no such value
    return image.getvalue()


def _other_attribute(node: Any, random_: random.Random) -> None:
    """Remove or replace an attribute."""
    name = random_.choice(sorted(node.attrs))
    del node.attrs[name]
    if random_.random() < 0.85:
        node.attrs[name] = random_.choice(_VALUES)


def _other_node(file: Any, node: Any, random_: random.Random) -> None:
    """Remove, replace, pack or relink a dataset or a group."""
    path, parent, name = node.name, node.parent, node.name.rsplit("/", 1)[-1]
    dataset = isinstance(node, h5py.Dataset)
    values, kept = (node[()], dict(node.attrs)) if dataset else (None, {})
    del file[path]
    way = random_.randrange(9)
    if way == 0:
        parent[name] = h5py.SoftLink(path)
    elif way == 1:
        parent[name] = h5py.ExternalLink("nowhere.h5", "/")
    elif way == 2:
        parent.create_group(name)
    elif way == 3:
        parent[name] = np.dtype("f8")
    elif way == 4:
        parent.create_dataset(name, (2**40, 2**20), "f8", fillvalue=0.0)
    elif way == 5:
        parent[name] = random_.choice([v for v in _VALUES if not isinstance(v, h5py.Empty)])
    elif dataset and way == 6 and getattr(values, "ndim", 0):
        parent.create_dataset(name, data=values, compression="gzip")
    elif dataset and way == 7 and getattr(values, "ndim", 0):
        parent[name] = values[: len(values) // 2] if random_.random() < 0.5 else values[None]
    elif dataset and way == 8 and values.dtype.kind in "iuf":
        with np.errstate(all="ignore"):
            values = values.astype(random_.choice(("f4", "f8", "i1", "u8", ">f8", "c16", "S3")))
        parent[name] = values
    if name in parent and isinstance(parent.get(name, getlink=True), h5py.HardLink):
        parent[name].attrs.update(kept)


_BYTES: tuple[Mutation, ...] = (flip, overwrite, cut, remove, insert, blank)
_TEXTS: tuple[Mutation, ...] = (number, number, number, word, lines, lines, insert, flood)
_WAYS: dict[str, tuple[Mutation, ...]] = {
    "binary": (*_BYTES, flip, header_word, header_word, card, number),
    "text": (*_BYTES, *_TEXTS),
    "hdf5": (*_BYTES, flip, flip, overwrite, structure, structure, structure),
    "json": (*_BYTES, *_TEXTS, leaf, leaf, leaf, leaf),
}

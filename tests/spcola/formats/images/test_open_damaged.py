"""Images that are damaged or contradict their labels, and what reading needs."""

from __future__ import annotations

import tracemalloc
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from spcola.errors import FormatError, InvalidValueError, SpcolaError
from spcola.formats.images import open_image

from .opening import check, put, write_raster


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.fit", lambda s, p: s.fits_bytes(p.astype(">i2"))[:-1000]),
        ("a.cub", lambda s, p: s.isis_bytes(p, "UnsignedWord")[:-2]),
        ("a.cub", lambda s, p: s.isis_bytes(p, "UnsignedWord", tile=(16, 16))[:-2]),
        ("a.img", lambda s, p: s.pds3_text(16, "MSB_INTEGER", 101, record=20).encode().ljust(2000)
         + p.tobytes()[:-2]),
    ],
)  # fmt: skip
def test_truncated_files_are_refused_at_opening(samples, tmp_path, ramp, name, content) -> None:
    with pytest.raises(FormatError, match="truncated"):
        open_image(put(tmp_path / name, content(samples, ramp)))


@pytest.mark.parametrize("dtype", ["u2", "i4", "f4", "f8"])
@pytest.mark.parametrize("stated", [">", "<"])
def test_the_wrong_byte_order_is_refused(samples, tmp_path, ramp, dtype, stated) -> None:
    names = {"u2": "UNSIGNED_INTEGER", "i4": "INTEGER", "f4": "REAL", "f8": "REAL"}
    order = ("IEEE" if "f" in dtype else "MSB") if stated == ">" else "PC"
    noise = np.random.default_rng(2).normal(0, 20, ramp.shape)
    pixels = np.clip(ramp + noise, 0, None).astype(stated + dtype)
    label = samples.pds3_text(pixels.dtype.itemsize * 8, f"{order}_{names[dtype]}", '"a.img"')
    path = put(tmp_path / "a.lbl", label)
    put(tmp_path / "a.img", pixels.tobytes())
    check(open_image(path), pixels)
    put(tmp_path / "a.img", pixels.byteswap().tobytes())
    with pytest.raises(FormatError, match="contradict the byte order in its label"):
        open_image(path).read()


def test_eight_bits_moved_up_are_no_contradiction(samples, tmp_path, ramp) -> None:
    pixels = (ramp // 16 * 256).astype(">u2")
    put(tmp_path / "a.img", pixels.tobytes())
    label = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"')
    check(open_image(put(tmp_path / "a.lbl", label)), pixels)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"pointer": '"other.img"'},
            "names other.img, which is not in the same folder|cannot be read",
        ),
        ({"pointer": '"../a.img"'}, "names|cannot be read"),
        ({"kind": "VAX_REAL", "bits": 32}, "which are not read|cannot be read"),
        ({"more": " BANDS = 3\r\n"}, "has 3 bands stored as None, one is needed|cannot be read"),
        ({"more": ' ENCODING_TYPE = "HUFFMAN"\r\n'}, "is compressed|cannot be read"),
        ({"lines": 400}, "has 2400 bytes, its label needs 24000"),
    ],
)
def test_pds3_labels_that_cannot_be_used(samples, tmp_path, ramp, change, message) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    entries = {"bits": 16, "kind": "MSB_UNSIGNED_INTEGER", "pointer": '"a.img"'} | change
    with pytest.raises(FormatError, match=message):
        open_image(put(tmp_path / "a.lbl", samples.pds3_text(**entries)))


@pytest.mark.parametrize("cards", [[("BSCALE", 0.0)], [("BZERO", "1E300")]])
def test_impossible_scalings_are_refused(samples, tmp_path, ramp, cards) -> None:
    content = samples.fits_bytes(ramp.astype(">i2"), cards).replace(b"'1E300   '", b"1E300     ")
    with pytest.raises(FormatError, match="has an impossible scaling"):
        open_image(put(tmp_path / "a.fits", content))


def test_an_end_before_the_start_is_refused(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    text = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"').replace(
        "24T05:00:00.020", "23T05:00"
    )
    label = open_image(put(tmp_path / "a.lbl", text)).label
    with pytest.raises(FormatError, match="before it starts"):
        label.mid_exposure()


def test_labels_of_tables_are_refused(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.tobytes())
    texts = {
        "a.lbl": samples.pds3_text(16, "MSB_INTEGER", '"a.img"').replace("IMAGE", "TABLE"),
        "b.xml": samples.pds4_text("a.img", 2400, "UnsignedLSB2").replace(
            "Array_2D_I", "Array_2D_T"
        ),
    }
    for name, text in texts.items():
        with pytest.raises(FormatError, match="without an image; name the data file"):
            open_image(put(tmp_path / name, text))


def test_an_unknown_encoding_is_refused(samples, tmp_path, ramp) -> None:
    text = samples.pds4_text("a.dat", 2400, "UnsignedLSB2").replace("UTF-8", "UTF-9")
    with pytest.raises(FormatError, match="cannot be read as XML"):
        open_image(put(tmp_path / "a.xml", text))


def test_contradicting_display_directions_give_none(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.dat", ramp.astype("<u2").tobytes())
    text = samples.pds4_text("a.dat", 2400, "UnsignedLSB2")
    part = text[text.index("<disp:Display_Settings>") : text.index("<img:Imaging>")]
    other = part.replace("Left to Right", "Right to Left")
    image = open_image(put(tmp_path / "a.xml", text.replace(part, part + other)))
    assert image.label.orientation is None
    assert image.notes[0].startswith("the label's display directions contradict each other")


@pytest.mark.parametrize("window", [slice(0, 41), slice(5, 5), slice(-3, None), slice(0, 9, 2)])
def test_windows_beyond_the_image_are_refused(samples, tmp_path, ramp, window) -> None:
    image = open_image(put(tmp_path / "a.fit", samples.fits_bytes(ramp.astype(">i2"))))
    with pytest.raises(InvalidValueError, match="is no window of 40 lines"):
        image.read(lines=window)


def test_a_window_of_a_huge_image_needs_little_memory(samples, tmp_path) -> None:
    size = 30000
    with (tmp_path / "a.img").open("wb") as stream:
        stream.truncate(2 * size * size)
    label = samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"', lines=size, samples=size)
    path = put(tmp_path / "a.lbl", label)
    open_image(path)  # imports
    tracemalloc.start()
    image = open_image(path)
    values = image.read(lines=slice(29000, 29010), samples=slice(10, 20)).values
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert values.shape == (10, 10)
    assert peak < 4_000_000


def test_every_line_of_a_label_corrupted_once(samples, tmp_path, ramp) -> None:
    put(tmp_path / "a.img", ramp.astype(">u2").tobytes())
    put(tmp_path / "a.dat", ramp.astype("<u2").tobytes())
    labels = {
        "a.lbl": samples.pds3_text(16, "MSB_UNSIGNED_INTEGER", '"a.img"'),
        "a.xml": samples.pds4_text("a.dat", 2400, "UnsignedLSB2"),
        "a.cub": samples.isis_bytes(ramp, "UnsignedWord")[:4096].decode(),
    }
    tail = {"a.cub": samples.isis_bytes(ramp, "UnsignedWord")[4096:]}
    refused = 0
    for name, text in labels.items():
        lines = text.splitlines(keepends=True)
        for number in range(len(lines)):
            for new in ("", "\x00\xff = (((\n", lines[number].replace("=", "= -")):
                changed = "".join([*lines[:number], new, *lines[number + 1 :]])
                head = changed.encode("latin-1")
                if name in tail:
                    head = head.ljust(4096, b"\0")[:4096] + tail[name]
                put(tmp_path / name, head)
                try:
                    image = open_image(tmp_path / name)
                    image.read()
                    image.label.mid_exposure()
                except SpcolaError:
                    refused += 1
    assert refused > 60


def test_threads_do_not_disturb_each_other(samples, tmp_path, ramp) -> None:
    paths = []
    for number in range(20):
        paths.append(put(tmp_path / f"{number}.fit", samples.fits_bytes(ramp.astype(">i2"))))
        paths.append(write_raster(tmp_path / f"{number}.png", "PNG", [ramp]))
    before = list(warnings.filters)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda path: open_image(path).read().values, paths):
            np.testing.assert_array_equal(found, ramp)
    assert list(warnings.filters) == before

"""How many bytes a pixel has by content: right files are never taken for others."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from spcola.formats.images import open_image, write_image_data
from spcola.formats.images.depth import bytes_by_content

SIZE = 65, 90


def scene(shape=SIZE, noise=0.01):
    """Smooth ground with noise, 0 … 1."""
    rng = np.random.default_rng(4)
    ground = ndimage.gaussian_filter(rng.normal(size=shape), 4.0)
    ground = 0.5 + 0.2 * ground / ground.std() + noise * rng.normal(size=shape)
    return np.clip(ground, 0.0, 1.0)


def written(path, pixels, order=">"):
    write_image_data(path, pixels, byte_order=order)
    return path


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize("most", [1000, 4095, 65535])
def test_sixteen_bits_and_half_of_them(tmp_path, order, most):
    pixels = np.rint(most * scene()).astype(np.uint16)
    path = written(tmp_path / "I.DAT", pixels, order)
    assert bytes_by_content(path, *SIZE[::-1]) == 2
    path.write_bytes(path.read_bytes()[: pixels.size])
    assert bytes_by_content(path, *SIZE[::-1]) == 2
    # An odd number of samples.
    other = written(tmp_path / "J.DAT", np.ascontiguousarray(pixels.T), order)
    other.write_bytes(other.read_bytes()[: pixels.size])
    assert bytes_by_content(other, *SIZE) == 2


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
def test_eight_bits_and_those_of_twice_as_many_pixels(tmp_path, noise):
    pixels = np.rint(255 * scene((66, 90), noise)).astype(np.uint8)
    path = written(tmp_path / "I.DAT", pixels)
    assert bytes_by_content(path, 90, 66) == 1
    assert bytes_by_content(path, 90, 33) == 1
    assert bytes_by_content(path, 45, 66) == 1


def test_eight_bits_that_were_multiplied_are_of_two_bytes_or_undecided(tmp_path):
    eight = np.rint(255 * scene()).astype(np.uint16)
    for factor in (1, 2, 16, 255, 256, 257):
        path = written(tmp_path / f"I{factor}.DAT", (factor * eight).astype(np.uint16))
        assert bytes_by_content(path, *SIZE[::-1]) in (0, 2), factor


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_uniform_frames_hot_pixels_and_other_lengths_are_undecided(tmp_path, kind):
    frame = np.zeros(SIZE, dtype=kind)
    assert bytes_by_content(written(tmp_path / "D.DAT", frame), *SIZE[::-1]) == 0
    frame[5, 7] = 200
    assert bytes_by_content(written(tmp_path / "H.DAT", frame), *SIZE[::-1]) == 0
    assert bytes_by_content(tmp_path / "H.DAT", 64, 90) == 0
    (tmp_path / "E.DAT").touch()
    assert bytes_by_content(tmp_path / "E.DAT", *SIZE[::-1]) == 0
    assert bytes_by_content(written(tmp_path / "O.DAT", frame[:1, :1]), 1, 1) == 0


@pytest.mark.real_data
def test_real_frames_are_what_they_are(shared_data, tmp_path):
    paths = [
        *sorted((shared_data / "rosetta_67p/navcam/images").glob("*.png"))[::10],
        *sorted((shared_data / "vesta/images").glob("*.png")),
        *sorted((shared_data / "apollo15").glob("*.png")),
    ]
    assert len(paths) > 10
    for path in paths:
        values = np.nan_to_num(open_image(path).read().values)
        full = values / values.max()
        rows, columns = full.shape[0] // 2 * 2, full.shape[1]
        one = written(tmp_path / "1.DAT", np.rint(255 * full[:rows]).astype(np.uint8))
        assert bytes_by_content(one, columns, rows) == 1, path.name
        assert bytes_by_content(one, columns, rows // 2) == 1, path.name
        # Numbers of a calibrated frame.
        fine = np.rint(50000 * ndimage.gaussian_filter(full[:rows], 0.7)).astype(np.uint16)
        two = written(tmp_path / "2.DAT", fine)
        assert bytes_by_content(two, columns, rows) in (0, 2), path.name
        two.write_bytes(two.read_bytes()[: fine.size])
        assert bytes_by_content(two, columns, rows) == 2, path.name

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spcola.errors import FormatError
from spcola.formats.cameras.stars import read_attitudes, read_star_catalogue, read_star_positions


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "t.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_a_catalogue_with_any_separator(tmp_path: Path, mark: str) -> None:
    text = "# Tycho\nRA Dec mag\n0 0 1\n90 0 2.5\n\n10 90 3\n".replace(" ", mark)
    sky = read_star_catalogue(written(tmp_path, text))
    np.testing.assert_allclose(sky.directions, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(sky.magnitudes, [1, 2.5, 3])


def test_positions_by_image_with_their_covariance(tmp_path: Path) -> None:
    head = "image,pixel,line,sigma_pixel,sigma_line,correlation"
    text = f"{head}\nA,1,2,0.1,0.2,0.5\nB,3,4,1,1,0\nA,5,6,1,2,0\n"
    found = read_star_positions(written(tmp_path, text))
    assert list(found) == ["A", "B"]
    np.testing.assert_array_equal(found["A"].pixel, [1, 5])
    np.testing.assert_allclose(found["A"].covariance[0], [[0.01, 0.01], [0.01, 0.04]])
    plain = read_star_positions(written(tmp_path, "image pixel line\nA 1 2\n"))
    np.testing.assert_allclose(plain["A"].covariance[0], 0.01 * np.eye(2))


def test_attitudes_by_hand(tmp_path: Path) -> None:
    text = "image,ra,dec,twist,vx,vy,vz,sigma,file\nA,0,0,0,1,2,3,0.5,a.fits\nB,90,0,90,0,0,0,1,\n"
    found = read_attitudes(written(tmp_path, text))
    # at (0, 0) east is y and north z; Cx lies in the east without twist
    np.testing.assert_allclose(found["A"].axes, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(found["B"].axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_array_equal(found["A"].velocity, [1e3, 2e3, 3e3])
    assert found["A"].sigma == pytest.approx(np.radians(0.5))
    assert found["A"].file == tmp_path / "a.fits"
    assert found["B"].file is None
    bare = read_attitudes(written(tmp_path, "image ra dec twist\nA 1 2 3\n"))["A"]
    assert bare.sigma == np.inf


@pytest.mark.parametrize(
    ("reader", "text", "message"),
    [
        (read_star_catalogue, "ra,dec\n1,2\n", "has no column mag"),
        (read_star_catalogue, "ra,dec,mag\n1,2\n", r"line 2: has 2 values for 3 columns"),
        (read_star_catalogue, "ra,dec,mag\n1,x,3\n", r"line 2: 'x' is not a number"),
        (read_star_catalogue, "ra,dec,mag\n1,100,3\n", r"line 2: RA 1, Dec 100 are no angles"),
        (read_star_catalogue, "ra,dec,mag\n", "has no header and rows"),
        (read_star_positions, "pixel,line\n1,2\n", "has no column image"),
        (read_star_positions, "image,pixel,line,sigma\nA,1,2,0\n", "not positive definite"),
        (read_attitudes, "image,ra,dec,twist\nA,1,2,3\nA,1,2,3\n", "line 3: image A comes twice"),
        (read_attitudes, "image,ra,dec,twist,sigma\nA,1,2,3,0\n", "sigma must be positive"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, reader, text: str, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        reader(written(tmp_path, text))


def test_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"ra,dec,mag\n\xff\xfe")
    with pytest.raises(FormatError, match="is not text"):
        read_star_catalogue(path)

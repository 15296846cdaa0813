"""Sigma companions of albedo and slopes: bytes in their order, unknown values, damaged files."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import FormatError
from spcola.formats.image_sigmas import (
    read_albedo_sigma,
    read_slope_sigma,
    write_albedo_sigma,
    write_slope_sigma,
)


def test_the_sigma_of_an_albedo_is_kept_where_it_is_known_and_where_it_is_not(tmp_path):
    sigma = np.linspace(0.0, 0.5, 25).reshape(5, 5)
    sigma[1, 3] = np.nan
    write_albedo_sigma(tmp_path / "AB0001.MAP", sigma)
    path = tmp_path / "AB0001.ASG"
    # The fast index runs along Uy: rows.
    assert np.frombuffer(path.read_bytes(), ">f4")[1] == np.float32(sigma[1, 0])
    np.testing.assert_allclose(read_albedo_sigma(path, 2), sigma, rtol=1e-6)
    with pytest.raises(FormatError, match="100 bytes, 196 belong"):
        read_albedo_sigma(path, 3)
    path.write_bytes(np.full(25, -0.1, ">f4").tobytes())
    with pytest.raises(FormatError, match="no sigma of an albedo"):
        read_albedo_sigma(path, 2)


def test_the_sigmas_of_slopes_are_those_of_cells_along_x_and_along_y(tmp_path):
    sigma = np.linspace(0.0, 0.5, 32).reshape(2, 4, 4)
    sigma[:, 1, 3] = np.nan
    write_slope_sigma(tmp_path / "AB0001.MAP", sigma)
    path = tmp_path / "AB0001.SSG"
    stored = np.frombuffer(path.read_bytes(), ">f4")
    assert stored[1] == np.float32(sigma[0, 1, 0])
    assert stored[16] == np.float32(sigma[1, 0, 0])
    np.testing.assert_allclose(read_slope_sigma(path, 2), sigma, rtol=1e-6)
    with pytest.raises(FormatError, match="128 bytes, 288 belong"):
        read_slope_sigma(path, 3)
    path.write_bytes(np.full(32, np.inf, ">f4").tobytes())
    with pytest.raises(FormatError, match="no sigma of slopes"):
        read_slope_sigma(path, 2)

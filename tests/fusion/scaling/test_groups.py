from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.scaling.fit.groups import ErrorGroups, pointing_of_scans
from fusion.scaling.fit.observation import ScaleObservations


def pairs(count=6):
    """Pairs of three scans on two days, from all sides."""
    generator = np.random.default_rng(1)
    normal = generator.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return ScaleObservations(
        kind="pairs",
        label=tuple(f"I{n}" for n in range(count)),
        day=tuple(f"2019-07-0{1 + n % 2}" for n in range(count)),
        value=np.zeros((count, 3)),
        covariance=np.broadcast_to(1e-4 * np.eye(3), (count, 3, 3)),
        point=245.0 * normal,
        beam=-normal,
        range=generator.uniform(800.0, 1200.0, count),
        normal=normal,
        local_time_h=np.full(count, np.nan),
        shares=np.eye(count),
        trajectory="spc",
        scan=tuple(f"scan{n // 2}" for n in range(count)),
    )


def test_pointing_of_a_scan_displaces_across_the_beam_and_with_the_range():
    data = pairs()
    effect = pointing_of_scans(data)
    along = np.einsum("ni,nir->nr", data.beam, effect)
    np.testing.assert_allclose(along, 0.0, atol=1e-12)
    # Two axes across the beam, each displaced by the range over the mean range of the scan.
    of_first = effect[0, :, :3]
    mean = data.range[:2].mean()
    np.testing.assert_allclose(
        np.linalg.svd(of_first)[1], [data.range[0] / mean] * 2 + [0.0], atol=1e-12
    )
    np.testing.assert_array_equal(effect[2:, :, :3], 0.0)


def test_pointing_of_a_scan_does_not_change_the_range():
    def in_range(scan_sigma_m):
        groups = ErrorGroups.of(pairs(), 0.2, scan_sigma_m, 0.02)
        states = groups.in_range(pairs())[0][:, 0]
        return states @ states.T

    np.testing.assert_allclose(in_range(5.0), in_range(0.0), atol=1e-12)


def test_a_day_errs_along_the_beams_of_its_pairs():
    data = pairs()
    groups = ErrorGroups.of(data, 0.2, 0.05, 0.02)
    of_days = groups.in_range(data)[1][:, 0]
    np.testing.assert_allclose(of_days, [[1, 0], [0, 1]] * 3, atol=1e-12)
    assert groups.sizes == (0.2, 0.02, 0.0)
    one = replace(data, day=("2019-07-01",) * 6)
    assert ErrorGroups.of(one, 0.2, 0.05, 0.02).sizes[1] == 0.0

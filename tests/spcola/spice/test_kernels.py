from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import spiceypy
from kernel_files import image_times, spk

from spcola.errors import KernelError
from spcola.formats.shapes import read_obj_mesh
from spcola.navigation import et_from_utc, utc_from_et
from spcola.shape import RayCaster
from spcola.spice import KernelSet, body_fixed_states

BENNU = 2101955
PCK = """KPL/PCK
A comment that says BODY2101955_PM = ( 1.0 2.0 ) is no data.
\\begindata
  BODY2101955_POLE_RA  = ( 85.0 0.0 0.0 )
  BODY2101955_POLE_DEC = ( -60.0 0.0 0.0 )
  BODY2101955_PM       = ( {w0} 2.011146D+03 0.0 )
\\begintext
"""


def pck(folder: Path, name: str, w0: str) -> Path:
    path = folder / name
    path.write_text(PCK.format(w0=w0))
    return path


def test_two_prime_meridians_are_refused_unless_one_is_chosen(tmp_path: Path) -> None:
    first, second = pck(tmp_path, "a.tpc", "154.92"), pck(tmp_path, "b.tpc", "45.61")
    with pytest.raises(
        KernelError,
        match=r"a\.tpc: BODY2101955_PM is \(154\.92, .* but \(45\.61, .* in b\.tpc: "
        "turned by up to 109 deg, ",
    ):
        KernelSet([first, second])
    assert KernelSet([first, second], prime_meridian="a.tpc").paths == [second, first]
    assert KernelSet([first, second], prime_meridian=second).paths == [first, second]
    with pytest.raises(KernelError, match=r"choose from: a\.tpc, b\.tpc"):
        KernelSet([first, second], prime_meridian="c.tpc")


def test_kernels_that_agree_are_no_contradiction(tmp_path: Path) -> None:
    first, second = pck(tmp_path, "a.tpc", "154.92"), pck(tmp_path, "b.tpc", "1.5492D+02")
    assert KernelSet([first, second]).paths == [first, second]


def test_the_chosen_meridian_counts(tmp_path: Path) -> None:
    paths = [pck(tmp_path, "a.tpc", "10.0"), pck(tmp_path, "b.tpc", "40.0")]
    rotations = []
    for chosen in ("a.tpc", "b.tpc"):
        with KernelSet(paths, prime_meridian=chosen).load():
            rotations.append(spiceypy.tipbod("J2000", BENNU, 0.0))
    turn = rotations[1] @ rotations[0].T
    assert np.degrees(np.arctan2(turn[0, 1], turn[0, 0])) == pytest.approx(30.0)


@pytest.mark.parametrize("absolute", [True, False])
def test_meta_kernel_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, absolute: bool
) -> None:
    (tmp_path / "deep").mkdir()
    kernel = pck(tmp_path / "deep", "a.tpc", "10.0")
    place = str(tmp_path) if absolute else "."
    meta = tmp_path / "set.tm"
    meta.write_text(
        "KPL/MK\n\\begindata\n"
        f"PATH_VALUES = ( '{place}' )\nPATH_SYMBOLS = ( 'K' )\n"
        "KERNELS_TO_LOAD = ( '$K/de+'\n 'ep/a.tpc' )\n\\begintext\n"
    )
    monkeypatch.chdir("/")
    (found,) = KernelSet(meta).paths
    assert found.samefile(kernel)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("KERNELS_TO_LOAD = ( 'none.tpc' )", "is not a file"),
        ("KERNELS_TO_LOAD = ( )", "is empty"),
        ("PATH_SYMBOLS = ( 'K' )\nKERNELS_TO_LOAD = ( 'a' )", "1 PATH_SYMBOLS for 0"),
        ("BODY1_PM = ( north )", "not a list of numbers"),
    ],
)
def test_bad_text_kernels(tmp_path: Path, data: str, message: str) -> None:
    path = tmp_path / "bad.tm"
    path.write_text(f"KPL/MK\n\\begindata\n{data}\n\\begintext\n")
    with pytest.raises(KernelError, match=message):
        KernelSet(path)


def test_missing_kernel_and_kernel_that_spice_refuses(tmp_path: Path) -> None:
    with pytest.raises(KernelError, match=r"none\.bsp: is not a file"):
        KernelSet(tmp_path / "none.bsp")
    rubbish = tmp_path / "bad.bsp"
    rubbish.write_bytes(b"DAF/SPK " + bytes(1016))
    before = spiceypy.ktotal("ALL")
    with (
        pytest.raises(KernelError, match=r"bad\.bsp: is no whole binary kernel"),
        KernelSet([pck(tmp_path, "a.tpc", "1.0"), rubbish]).load(),
    ):
        pass
    assert spiceypy.ktotal("ALL") == before


def test_the_pool_is_given_back_after_an_error(tmp_path: Path) -> None:
    before = spiceypy.ktotal("ALL")
    kernels = KernelSet(pck(tmp_path, "a.tpc", "1.0"))
    with pytest.raises(ZeroDivisionError), kernels.load():
        raise ZeroDivisionError
    assert spiceypy.ktotal("ALL") == before


def test_body_fixed_positions_turn_with_the_body(tmp_path: Path) -> None:
    times = np.arange(5) * 1000.0
    states = np.tile([3.0, 4.0, 5.0, 0.0, 0.0, 0.0], (5, 1))
    kernel = spk(tmp_path / "still.bsp", times, states)
    np.testing.assert_array_equal(image_times(kernel), times)
    with KernelSet([kernel, pck(tmp_path, "a.tpc", "10.0")]).load():
        position, axes = body_fixed_states(-999, BENNU, times, frame="J2000")
        assert np.isnan(body_fixed_states(-999, BENNU, [1e6])[0]).all()
        with pytest.raises(KernelError, match="at 2101955 in NOWHERE: SPICE reports"):
            body_fixed_states("", BENNU, [0.0], frame="NOWHERE")
    np.testing.assert_allclose(np.linalg.norm(position, axis=1), 1000 * np.sqrt(50.0))
    np.testing.assert_allclose(axes.transpose(0, 2, 1) @ [3000.0, 4000.0, 5000.0], position)
    lon = np.unwrap(np.arctan2(position[:, 1], position[:, 0]))
    rate = np.degrees(np.diff(lon)) / 1000.0 * 86400.0
    np.testing.assert_allclose(rate, -2.011146e3, rtol=1e-9)


@pytest.mark.real_data
class TestSpcStates:
    """The SPC solution of 2018-11-08 … 12-02: 756 images."""

    def kernels(self, shared_data: Path, *pcks: str, chosen: str | None = None) -> KernelSet:
        states = shared_data / "bennu" / "spc_states_181108"
        frames = shared_data / "bennu" / "kernels_mapcam_20190303"
        return KernelSet(
            [
                states / "naif0012.tls",
                frames / "orx_sclkscet_00065.tsc",
                frames / "orx_v14.tf",
                states / "orx_s_181108_181217_ALTP_v01.bsp",
                states / "orx_s_181108_181217_ALTP_v01.bc",
                *(states / pck for pck in pcks),
            ],
            prime_meridian=chosen,
        )

    def times(self, shared_data: Path) -> np.ndarray:
        name = "orx_s_181108_181217_ALTP_v01.bsp"
        return image_times(shared_data / "bennu" / "spc_states_181108" / name)

    @pytest.mark.parametrize("pck", ["bennu_pck_altwg_V34.v2.tpc", "bennu_pck_od090.tpc"])
    def test_756_states_with_either_pck(self, shared_data: Path, pck: str) -> None:
        times = self.times(shared_data)
        assert len(times) == 756
        with self.kernels(shared_data, pck).load():
            bus = "ORX_SPACECRAFT"
            assert np.isnan(body_fixed_states("", BENNU, times[-1:], frame=bus)[1]).all()
            position, axes = body_fixed_states(-64, BENNU, times, frame=bus, tolerance_s=0.2)
        assert utc_from_et(times[0]).startswith("2018 NOV 08")
        distance = np.linalg.norm(position, axis=1)
        assert distance[0] == pytest.approx(162_863.19, abs=0.01)
        assert distance.min() > 5e3
        # PolyCam looks along the spacecraft's +Z: Bennu stands within a degree of it
        cosine = -np.sum(axes[:, 2] * position, axis=1) / distance
        assert np.degrees(np.arccos(np.median(cosine))) < 0.2

    def test_the_two_are_refused_together_and_differ_by_a_third_of_a_degree(
        self, shared_data: Path
    ) -> None:
        both = ("bennu_pck_altwg_V34.v2.tpc", "bennu_pck_od090.tpc")
        with pytest.raises(KernelError, match=r"V34.*POLE_RA is .*_PM is \(138\.8220994, .*od090"):
            self.kernels(shared_data, *both)
        longitudes = []
        for chosen in both:
            with self.kernels(shared_data, *both, chosen=chosen).load():
                position, _ = body_fixed_states(-64, BENNU, self.times(shared_data)[:1])
            longitudes.append(np.degrees(np.arctan2(position[0, 1], position[0, 0])))
        assert abs(longitudes[0] - longitudes[1]) == pytest.approx(0.387, abs=1e-3)


@pytest.mark.real_data
def test_mapcam_boresight_meets_bennu(shared_data: Path) -> None:
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    texts = [
        "naif0012.tls", "pck00010.tpc", "bennu_v16.tpc", "orx_v14.tf", "orx_sclkscet_00065.tsc",
        "orx_ocams_v07.ti", "orex_ocams_addendum_v10.ti",
    ]  # fmt: skip
    kernels = KernelSet([folder / t for t in texts] + sorted(folder.glob("*.x*")))
    # StartTime of the image's label; the kernels cover 10:57:40 to 11:01:45 TDB
    et = et_from_utc("2019-03-03T10:59:40.279")
    with kernels.load():
        position, axes = body_fixed_states(-64, BENNU, [et], frame="ORX_OCAMS_MAPCAM")
    shape = read_obj_mesh(shared_data / "bennu" / "g_12570mm_alt_obj_0000n00000_v014.obj")
    hit = RayCaster(shape).cast(position, axes[0, 2:])
    assert hit.hit[0]
    assert hit.distance[0] == pytest.approx(6351.6, abs=30.0)
    assert np.linalg.norm(hit.points[0]) == pytest.approx(250.0, abs=40.0)

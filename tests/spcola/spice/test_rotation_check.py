"""Kernels that turn a body differently are refused, whichever constant it is that differs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import spiceypy

from spcola.errors import KernelError
from spcola.navigation import et_from_utc
from spcola.spice import KernelSet, KernelUse, orientation_of
from spcola.spice.daf import daf_segments, state_epochs

PHOBOS = 401
NOVEMBER = et_from_utc("2018-11-08T00:00:00") + 86400.0 * np.arange(25.0)
# A body with all constants of SPICE: its rotation, two periodic terms, and frame and epoch.
WHOLE = {
    "BODY401_POLE_RA": "( 317.68 -0.108 0.0 )",
    "BODY401_POLE_DEC": "( 52.90 -0.061 0.0 )",
    "BODY401_PM": "( 35.06 1128.8445850 6.644D-09 )",
    "BODY4_NUT_PREC_ANGLES": "( 169.51 15916.28 192.93 41215163.19 )",
    "BODY401_NUT_PREC_RA": "( 1.79 0.5 )",
    "BODY401_NUT_PREC_DEC": "( -1.08 0.2 )",
    "BODY401_NUT_PREC_PM": "( -1.42 -0.78 )",
    "BODY4_CONSTANTS_REF_FRAME": "( 1 )",
    "BODY4_CONSTANTS_JED_EPOCH": "( 2451545.0 )",
    "BODY401_RADII": "( 13.0 11.4 9.1 )",
}
CHANGES = {
    "BODY401_POLE_RA": "( 317.78 -0.108 0.0 )",
    "BODY401_POLE_DEC": "( 52.90 -0.161 0.0 )",
    "BODY401_PM": "( 35.06 1128.8445850 6.7D-09 )",
    "BODY4_NUT_PREC_ANGLES": "( 169.51 15916.28 192.93 41215164.19 )",
    "BODY401_NUT_PREC_RA": "( 1.79 0.6 )",
    "BODY401_NUT_PREC_DEC": "( -1.08 )",
    "BODY401_NUT_PREC_PM": None,
    "BODY4_CONSTANTS_REF_FRAME": "( 17 )",
    "BODY4_CONSTANTS_JED_EPOCH": "( 2451545.5 )",
}


def kernel(path: Path, constants: dict[str, str | None]) -> Path:
    lines = [f"{name} = {text}" for name, text in constants.items() if text is not None]
    path.write_text("KPL/PCK\n\\begindata\n" + "\n".join(lines) + "\n\\begintext\n")
    return path


def use(body: int = PHOBOS, times: np.ndarray = NOVEMBER) -> KernelUse:
    return KernelUse(body, lambda: (times, 5000.0))


def rotations(kernels: KernelSet, body: int = PHOBOS) -> np.ndarray:
    with kernels.load():
        return np.array([spiceypy.tipbod("J2000", body, time) for time in NOVEMBER])


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("name", CHANGES)
def test_every_constant_is_compared_in_either_order(tmp_path: Path, name: str, first: bool) -> None:
    whole = kernel(tmp_path / "whole.tpc", WHOLE)
    other = kernel(tmp_path / "other.tpc", {**WHOLE, name: CHANGES[name]})
    paths = [whole, other] if first else [other, whole]
    with pytest.raises(
        KernelError, match=rf"{name} is .*, but .* at a radius of 1.3e\+04 m"
    ) as bad:
        KernelSet(paths, use=use())
    assert "whole.tpc" in str(bad.value)
    assert "other.tpc" in str(bad.value)
    assert "2018 NOV 08 to 2018 DEC 02" in str(bad.value)
    with pytest.raises(KernelError, match=name):
        KernelSet(paths)


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("name", CHANGES)
def test_the_chosen_kernel_counts_as_if_it_were_alone(
    tmp_path: Path, name: str, first: bool
) -> None:
    whole = kernel(tmp_path / "whole.tpc", WHOLE)
    other = kernel(tmp_path / "other.tpc", {**WHOLE, name: CHANGES[name]})
    paths = [whole, other] if first else [other, whole]
    for chosen in (whole, other):
        found = rotations(KernelSet(paths, prime_meridian=chosen.name, use=use()))
        np.testing.assert_array_equal(found, rotations(KernelSet(chosen)))


def test_a_size_is_that_of_the_rotation_between_the_two(tmp_path: Path) -> None:
    """Bennu's W2 over 19 years: 1.815e-6 deg/d² are 86 deg."""
    bennu = {
        "BODY2101955_POLE_RA": "85.45",
        "BODY2101955_POLE_DEC": "-60.36",
        "BODY2101955_PM": "( 138.82 2011.146 1.815E-06 )",
    }
    first = kernel(tmp_path / "first.tpc", bennu)
    bennu["BODY2101955_PM"] = "( 138.82 2011.146 )"
    second = kernel(tmp_path / "second.tpc", bennu)
    days = NOVEMBER / 86400.0
    angle = 1.815e-6 * days[-1] ** 2
    metres = 2 * 245.0 * np.sin(np.radians(angle) / 2)
    wanted = KernelUse(2101955, lambda: (NOVEMBER, 245.0))
    message = f"turned by up to {angle:.3g} deg or {metres:.3g} m at a radius of 245 m, 2018 NOV 0"
    with pytest.raises(KernelError, match=message):
        KernelSet([first, second], use=wanted)
    # At J2000 they are one.
    KernelSet([first, second], use=KernelUse(2101955, lambda: (np.zeros(1), 245.0)))


def test_rates_are_compared_by_what_they_come_to(tmp_path: Path) -> None:
    """A rate that differs by 2.3e-7 deg/d is 1.6e-3 deg off after 19 years: no 1e-6 deg."""
    first = kernel(tmp_path / "a.tpc", WHOLE)
    rate = {"BODY401_PM": "( 35.06 1128.84458523 6.644D-09 )"}
    second = kernel(tmp_path / "b.tpc", {**WHOLE, **rate})
    with pytest.raises(KernelError, match=r"up to 0\.0015\d* deg or 0\.3\d* m"):
        KernelSet([first, second], use=use())


def test_what_agrees_is_no_contradiction(tmp_path: Path) -> None:
    first = kernel(tmp_path / "a.tpc", WHOLE)
    other_notation = {
        "BODY401_POLE_RA": "( 3.1768D+02 -0.108 )",
        "BODY401_NUT_PREC_RA": "( 1.79 5d-1 )",
        "BODY4_CONSTANTS_REF_FRAME": None,
        "BODY4_CONSTANTS_JED_EPOCH": None,
    }
    second = kernel(tmp_path / "b.tpc", {**WHOLE, **other_notation})
    third = kernel(tmp_path / "radii.tpc", {"BODY401_RADII": "( 13.0 )"})
    KernelSet([first, second, third], use=use())
    # Kernels may share a body among them.
    parts = [
        kernel(tmp_path / f"{number}.tpc", {name: WHOLE[name] for name in names})
        for number, names in enumerate(
            [[n for n in WHOLE if "ANGLES" in n], [n for n in WHOLE if "401" in n]]
        )
    ]
    np.testing.assert_array_equal(
        rotations(KernelSet(parts, use=use())), rotations(KernelSet(first))
    )


def test_other_bodies_may_differ(tmp_path: Path) -> None:
    paths = [
        kernel(tmp_path / "a.tpc", {**WHOLE, "BODY499_PM": "( 176.63 350.89 )"}),
        kernel(tmp_path / "b.tpc", {**WHOLE, "BODY499_PM": "( 176.05 350.89 )"}),
    ]
    assert KernelSet(paths, use=use()).paths == paths
    with pytest.raises(KernelError, match="BODY499_PM"):
        KernelSet(paths)


def test_a_choice_settles_only_what_it_states(tmp_path: Path) -> None:
    changed = {**WHOLE, "BODY401_POLE_RA": CHANGES["BODY401_POLE_RA"]}
    paths = [kernel(tmp_path / "a.tpc", WHOLE), kernel(tmp_path / "b.tpc", changed)]
    meridian = kernel(tmp_path / "pm.tpc", {"BODY401_PM": "( 36.0 1128.8 )"})
    with pytest.raises(KernelError, match="BODY401_POLE_RA"):
        KernelSet([*paths, meridian], prime_meridian="pm.tpc", use=use())
    with pytest.raises(KernelError, match=r"choose from: a\.tpc, b\.tpc"):
        KernelSet(paths, prime_meridian="pm.tpc", use=use())


def test_values_that_are_added_to(tmp_path: Path) -> None:
    path = tmp_path / "plus.tpc"
    path.write_text(
        "KPL/PCK\n\\begindata\nBODY401_PM = ( 1.0\n 2.0 )\nBODY401_PM += 3.0\n\\begintext\n"
    )
    assert orientation_of(path).constants == {"BODY401_PM": (1.0, 2.0, 3.0)}


def test_terms_that_a_spin_lacks(tmp_path: Path) -> None:
    names = orientation_of(kernel(tmp_path / "a.tpc", WHOLE)).beyond_spin(PHOBOS)
    assert names == ("BODY401_NUT_PREC_RA", "BODY401_NUT_PREC_DEC", "BODY401_NUT_PREC_PM")
    epoch = {"BODY1_PM": "( 1 2 3 )", "BODY1_CONSTANTS_JED_EPOCH": "2451545.5"}
    epoch["BODY1_POLE_RA"] = "( 1 2 3 )"
    names = orientation_of(kernel(tmp_path / "b.tpc", epoch)).beyond_spin(1)
    assert names == ("BODY1_POLE_RA", "BODY1_CONSTANTS_JED_EPOCH")


@pytest.mark.real_data
def test_the_pcks_of_bennu_over_the_states(shared_data: Path) -> None:
    folder = shared_data / "bennu" / "spc_states_181108"
    states = folder / "orx_s_181108_181217_ALTP_v01.bsp"
    times = np.concatenate([state_epochs(one.values, states) for one in daf_segments(states)])
    paths = [folder / "bennu_pck_altwg_V34.v2.tpc", folder / "bennu_pck_od090.tpc"]
    wanted = KernelUse(2101955, lambda: (times, 245.0))
    with pytest.raises(KernelError, match=r"POLE_RA .*POLE_DEC .*_PM .*turned by up") as bad:
        KernelSet(paths, use=wanted)
    assert "at a radius of 282.5 m, 2018 NOV 08 to 2018 DEC 02" in str(bad.value)
    generic = shared_data / "bennu" / "kernels_mapcam_20190303" / "pck00010.tpc"
    KernelSet([generic, paths[0]])
    assert not orientation_of(paths[0]).beyond_spin(2101955)

"""Rough Hapke: values written out from the paper, and derivatives where the light lies in line."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.photometry.functions import photometric_function

W, B_0, H, XI, THETA_BAR = 0.3, 0.8, 0.05, -0.25, 25.0
ROUGH = photometric_function(f"hapke-rough w={W} B0={B_0} h={H} xi={XI} theta_bar={THETA_BAR}")


def smooth(mu_0: float, mu: float, phase: float) -> float:
    """Hapke (1981), without w / 4π."""
    gamma = np.sqrt(1 - W)
    h_0, h_1 = ((1 + 2 * x) / (1 + 2 * x * gamma) for x in (mu_0, mu))
    lobe = (1 - XI**2) / (1 + 2 * XI * np.cos(phase) + XI**2) ** 1.5
    surge = B_0 / (1 + np.tan(phase / 2) / H)
    return mu_0 / (mu_0 + mu) * ((1 + surge) * lobe + h_0 * h_1 - 1)


def rough(i: float, e: float, psi: float) -> float:
    """Hapke (1984): angles of incidence and emission, and the azimuth between their planes."""
    tangent = np.tan(np.radians(THETA_BAR))
    chi = 1 / np.sqrt(1 + np.pi * tangent**2)
    half = np.sin(psi / 2) ** 2

    def e_1(x: float) -> float:
        return np.exp(-2 / np.pi / tangent / np.tan(x))

    def e_2(x: float) -> float:
        return np.exp(-1 / np.pi / tangent**2 / np.tan(x) ** 2)

    def alone(x: float) -> float:
        return chi * (np.cos(x) + np.sin(x) * tangent * e_2(x) / (2 - e_1(x)))

    if i <= e:
        below = 2 - e_1(e) - psi / np.pi * e_1(i)
        lift_0 = (np.cos(psi) * e_2(e) + half * e_2(i)) / below
        lift = (e_2(e) - half * e_2(i)) / below
        less = np.cos(i) / alone(i)
    else:
        below = 2 - e_1(i) - psi / np.pi * e_1(e)
        lift_0 = (e_2(i) - half * e_2(e)) / below
        lift = (np.cos(psi) * e_2(i) + half * e_2(e)) / below
        less = np.cos(e) / alone(e)
    mu_0 = chi * (np.cos(i) + np.sin(i) * tangent * lift_0)
    mu = chi * (np.cos(e) + np.sin(e) * tangent * lift)
    f = np.exp(-2 * np.tan(psi / 2))
    shadows = mu / alone(e) * np.cos(i) / alone(i) * chi / (1 - f + f * chi * less)
    phase = np.arccos(np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi))
    # Seen from above in light from above both effective cosines are χ, and there are no shadows.
    return smooth(mu_0, mu, phase) * shadows / smooth(chi, chi, 0.0)


def place_of(i: float, e: float, psi: float) -> tuple[np.float64, ...]:
    """Cosines of both angles, and the phase."""
    cosine = np.cos(i) * np.cos(e) + np.sin(i) * np.sin(e) * np.cos(psi)
    return np.float64(np.cos(i)), np.float64(np.cos(e)), np.float64(np.arccos(cosine))


@pytest.mark.parametrize(
    ("i", "e", "psi"), [(0.5, 0.9, 1.1), (1.1, 0.4, 2.3), (0.7, 0.6, 0.05), (1.3, 1.2, 3.0)]
)
def test_rough_hapke_by_its_formula(i: float, e: float, psi: float) -> None:
    place = place_of(i, e, psi)
    assert ROUGH(*place) == pytest.approx(rough(i, e, psi), rel=1e-10)
    # Roughness matters there.
    assert ROUGH(*place) < 0.999 * smooth(*place) / smooth(1.0, 1.0, 0.0)


def seen(tx: float, ty: float, sun: np.ndarray, eye: np.ndarray) -> tuple[float, float, float]:
    """Angles of incidence and emission on ground of these slopes, and the azimuth between them."""
    normal = np.array([-tx, -ty, 1.0]) / np.sqrt(1.0 + tx**2 + ty**2)
    light, view = (one - (one @ normal) * normal for one in (sun, eye))
    i, e = (np.arctan2(np.linalg.norm(a), b @ normal) for a, b in ((light, sun), (view, eye)))
    # Exact also where both planes coincide.
    return i, e, np.arctan2(np.linalg.norm(np.cross(light, view)), light @ view)


LOW, HIGH = np.radians([50.0, 20.0])


@pytest.mark.parametrize("across", [0.0, 0.2], ids=["in-plane", "sloped-across"])
@pytest.mark.parametrize(
    ("sun", "eye"), [(LOW, HIGH), (HIGH, LOW), (LOW, -HIGH), (HIGH, -LOW)],
    ids=["sun-low", "camera-low", "opposite-sun-low", "opposite-camera-low"],
)  # fmt: skip
def test_derivatives_by_slopes_with_sun_and_camera_in_one_plane(
    sun: float, eye: float, across: float
) -> None:
    """Sun, camera and Uz lie in one plane, and the ground slopes along it, or across it too.

    Along the plane the azimuth does not change. Across it the brightness is symmetric: it has an
    edge where Sun and camera are on the same side, and no slope.
    """
    light, view = (np.array([np.sin(x), 0.0, np.cos(x)]) for x in (sun, eye))
    slopes, step = np.array([0.1, across]), 1e-4
    normal, steep = np.array([*-slopes, 1.0]), np.sqrt(1.0 + slopes @ slopes)
    cosines = [one @ normal / steep for one in (light, view)]
    phase = np.array([abs(sun - eye)])
    partials = ROUGH.partials(*(np.array([x]) for x in cosines), phase)
    by_i, by_e = partials.by_cos_incidence[0], partials.by_cos_emission[0]
    for k, way in enumerate(step * np.eye(2)):
        # Of the cosine between the normal and a direction.
        turns = [
            -one[k] / steep - cosine * slopes[k] / steep**2
            for one, cosine in zip((light, view), cosines, strict=True)
        ]
        high, low = (rough(*seen(*(slopes + sign * way), light, view)) for sign in (1, -1))
        numeric = (high - low) / (2.0 * step)
        assert by_i * turns[0] + by_e * turns[1] == pytest.approx(numeric, abs=1e-7)

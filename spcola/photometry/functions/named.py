"""Photometric functions by the names of settings, with their parameters."""

from __future__ import annotations

from collections.abc import Iterable

from spcola.errors import SettingsError
from spcola.photometry.functions.function import Parameter, PhotometricFunction
from spcola.photometry.functions.kernel import Code


def _cubic(what: str, defaults: tuple[float, float, float]) -> list[Parameter]:
    """Return the coefficients of a cubic in the phase angle, degrees."""
    return [
        Parameter("a", defaults[0], -0.2, 0.2, "1/deg", 0, f"{what}: of α"),
        Parameter("b", defaults[1], -5e-3, 5e-3, "1/deg²", 1, f"{what}: of α²"),
        Parameter("c", defaults[2], -5e-5, 5e-5, "1/deg³", 2, f"{what}: of α³"),
    ]


_HAPKE = [
    Parameter("w", 0.05, 0.0, 0.999, "", 0, "single-scattering albedo"),
    Parameter("B0", 1.0, 0.0, 5.0, "", 1, "amplitude of the opposition surge"),
    Parameter("h", 0.06, 1e-3, 1.0, "", 2, "angular width of the opposition surge"),
]
_ONE_LOBE = [
    *_HAPKE,
    Parameter("xi", -0.3, -0.95, 0.95, "", 3, "asymmetry of the lobe; < 0 scatters backward"),
]
_TWO_LOBES = [
    *_HAPKE,
    Parameter("b", 0.3, 0.0, 0.95, "", 3, "asymmetry of both lobes"),
    Parameter("c", 0.5, -1.0, 1.0, "", 4, "1 for the backward lobe alone, −1 the forward one"),
]
_ROUGHNESS = Parameter("theta_bar", 20.0, 0.0, 60.0, "deg", 5, "mean slope of unresolved ground")
# One lobe is the forward one (c = −1) of either sign.
_LOBE = (0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
_NONE = (0.0,) * 8


def _function(
    name: str,
    code: Code,
    parameters: Iterable[Parameter] = (),
    base: tuple[float, ...] = _NONE,
) -> PhotometricFunction:
    chosen = tuple(parameters)
    return PhotometricFunction(name, code, chosen, tuple(one.default for one in chosen), base)


# McEwen (1996, LPSC XXVII, 841) for the Moon: L = 1 + a α + b α² + c α³, α in degrees.
lunar_lambert = _function(
    "lunar-lambert", Code.MCEWEN, _cubic("weight L", (-0.019, 2.42e-4, -1.46e-6))
)
"""``2 L μ0 / (μ0 + μ) + (1 − L) μ0`` (McEwen 1991), L his cubic of 1996 between 0 and 1.

The truth images of Weirich et al. (section 2.6) were made with this function."""
lommel_seeliger = _function("lommel-seeliger", Code.LOMMEL_SEELIGER)
"""``2 μ0 / (μ0 + μ)``: single scattering in a dark regolith (Seeliger 1884)."""
lambert = _function("lambert", Code.LAMBERT)
"""``μ0``: equally bright from all directions (Lambert 1760)."""

PHOTOMETRIC_FUNCTIONS: dict[str, PhotometricFunction] = {
    one.name: one
    for one in (
        lunar_lambert,
        lommel_seeliger,
        lambert,
        # L = exp(−α / α0), α0 = 60°: the form for which SPC's functions are known (Gaskell 2008).
        _function(
            "lunar-lambert-exponential",
            Code.LUNAR_EXPONENTIAL,
            [Parameter("alpha0", 60.0, 5.0, 500.0, "deg", 0, "decay of the weight L by phase")],
        ),
        # exp(a α + b α² + c α³): the disk-resolved model of Bennu before arrival (Takir et al.
        # 2015). The defaults are of that order.
        _function(
            "lommel-seeliger-exponential",
            Code.LOMMEL_SEELIGER,
            _cubic("logarithm of the brightness", (-0.04, 2.5e-4, -9e-7)),
        ),
        _function(
            "lommel-seeliger-polynomial",
            Code.LOMMEL_SEELIGER_POLYNOMIAL,
            _cubic("brightness", (-0.015, 8e-5, -1.5e-7)),
        ),
        # Minnaert (1941), k linear in the phase angle.
        _function(
            "minnaert",
            Code.MINNAERT,
            [
                Parameter("k", 0.6, 0.0, 2.0, "", 0, "exponent at zero phase; 1 is Lambert"),
                Parameter("k_slope", 0.0, -0.02, 0.02, "1/deg", 1, "change of k by phase"),
            ],
        ),
        # Shkuratov et al. (2011, Planet. Space Sci. 59, 1326): without parameters, and with η.
        _function("akimov", Code.AKIMOV, base=(1.0, *_NONE[1:])),
        _function(
            "akimov-phase",
            Code.AKIMOV,
            [
                Parameter("eta", 0.52, 0.0, 2.0, "", 0, "exponent of the latitude"),
                Parameter("slope", -0.01, -0.1, 0.05, "1/deg", 1, "ln of the brightness by phase"),
            ],
        ),
        _function("hapke", Code.HAPKE, _ONE_LOBE, _LOBE),
        _function("hapke-two-lobes", Code.HAPKE, _TWO_LOBES),
        _function("hapke-rough", Code.HAPKE_ROUGH, [*_ONE_LOBE, _ROUGHNESS], _LOBE),
        _function("hapke-rough-two-lobes", Code.HAPKE_ROUGH, [*_TWO_LOBES, _ROUGHNESS]),
    )
}
"""Functions with default parameters, by their names in settings; add further ones here."""


def photometric_function(text: str) -> PhotometricFunction:
    """Return the function of a setting: a name, and parameters that differ from the defaults.

    Parameters
    ----------
    text : str
        Such as ``lunar-lambert`` or ``minnaert k=0.62 k_slope=0.001``.

    Raises
    ------
    SettingsError
        If there is none of that name, or a parameter is unknown or out of bounds.
    """
    name, *given = text.split() or [text]
    if name not in PHOTOMETRIC_FUNCTIONS:
        known = ", ".join(PHOTOMETRIC_FUNCTIONS)
        raise SettingsError(f"{name!r} is none of {known}", "photometric function")
    values = {}
    for one in given:
        key, _, number = one.partition("=")
        try:
            values[key] = float(number)
        except ValueError:
            raise SettingsError(
                f"{one!r} is not of the form parameter=number", f"photometric function {name}"
            ) from None
    return PHOTOMETRIC_FUNCTIONS[name].having(values)

"""Whether a result may be used: accepted, doubtful or refused, with a code for every reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Literal, Self

__all__ = ["JUDGEMENTS", "Cause", "Code", "Finding", "Severity", "Verdict", "verdict_lines"]

Judgement = Literal["accepted", "doubtful", "refused"]
JUDGEMENTS: tuple[Judgement, ...] = ("accepted", "doubtful", "refused")
"""From the best to the worst."""


class Severity(StrEnum):
    """Effect of a finding: none, the user has to accept it, or the result is refused."""

    NOTE = "note"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


class CodedText(StrEnum):
    """A code for other programs, with its meaning as text."""

    meaning: str

    def __new__(cls, code: str, meaning: str = "") -> Self:
        """Return the member with the value `code`."""
        member = str.__new__(cls, code)
        member._value_, member.meaning = code, meaning
        return member


class Code(CodedText):
    """Codes of findings."""

    CHANGED_INPUT = "changed-input", "a file differs from what the stage that wrote it recorded"
    NO_MATCH = "no-match", "no mapola matches the SPC surface"
    NO_OVERLAP = "no-overlap", "the two clouds or surfaces do not overlap"
    NO_RELIEF = (
        "no-relief",
        "there is too little relief to verify that lidar and SPC show the same ground",
    )
    RELIEF_UNRELATED = (
        "relief-unrelated",
        "lidar and SPC do not show the same relief after registration",
    )
    FEW_AGREE = "few-agree", "few mapolas agree with the common transform"
    IMAGES_NOT_MATCHED = (
        "images-not-matched",
        "many images do not show the relief that the lidar measured there",
    )
    IMAGES_DISAGREE = (
        "images-disagree",
        "images place the lidar's ground elsewhere than its heights do",
    )
    HEIGHTS_DISAGREE = "heights-disagree", "heights differ by more than their stated sigmas"
    CENTERS_DISAGREE = (
        "centers-disagree",
        "centres of maplets are off by more than their stated sigmas",
    )
    LARGE_SCALE = "large-scale", "the scale is larger than plausible for two solutions of one body"
    LARGE_ROTATION = (
        "large-rotation",
        "the rotation is larger than plausible for two solutions of one body",
    )
    STRAIN = "strain", "lidar and SPC differ by a shear or a non-uniform scale"
    NOT_CONVERGED = "not-converged", "the fit did not converge"
    NOT_DETERMINED = "not-determined", "the data do not determine a parameter"
    WEAKLY_DETERMINED = (
        "weakly-determined",
        "a parameter is weakly determined, or not separable from another",
    )
    FITS_OTHERWISE = "fits-otherwise", "the lidar fits the SPC surface in another frame or unit"
    MAPLET_CONTRADICTED = "maplet-contradicted", "the lidar contradicts the heights of a maplet"
    OUTSIDE_KERNELS = "outside-kernels", "returns lie at times that the SPICE kernels do not cover"
    SCALE_NOT_OBSERVED = (
        "scale-not-observed",
        "fewer than two pairs or shots agree: there is no scale",
    )
    SCALE_NOT_CONVERGED = "scale-not-converged", "the fit of the scale did not converge"
    SHOTS_FIT_ELSEWHERE = (
        "shots-fit-elsewhere",
        "shots fit the shape better rotated or mirrored than as they are",
    )
    SHOTS_FIT_BY_CHANCE = (
        "shots-fit-by-chance",
        "shots fit the shape equally well at a wrong place",
    )
    SCANS_FIT_ELSEWHERE = (
        "scans-fit-elsewhere",
        "single scans fit the shape better rotated or mirrored",
    )
    SCANS_DISAGREE = (
        "scans-disagree",
        "scans over the same ground differ by more than shots of one scan do",
    )
    SHOTS_MISS_SHAPE = "shots-miss-shape", "many shots miss the shape"
    SCATTER_TOO_LARGE = "scatter-too-large", "residuals scatter far more than their stated sigmas"
    PAIRS_NOT_MATCHED = "pairs-not-matched", "the surfaces of many pairs could not be matched"
    MANY_REJECTED = "many-rejected", "many pairs or shots disagree with the rest"
    EPSILON_BEYOND_PRIOR = "epsilon-beyond-prior", "epsilon is far larger than its prior"
    CENTRE_BEYOND_PRIOR = "centre-beyond-prior", "the centre is far beyond its prior"
    POLE_BEYOND_PRIOR = "pole-beyond-prior", "the pole is far beyond its prior"
    MERIDIAN_BEYOND_PRIOR = "meridian-beyond-prior", "the prime meridian is far beyond its prior"
    RANGE_BIAS_BEYOND_PRIOR = "range-bias-beyond-prior", "the range bias is far beyond its prior"
    DAYS_DISAGREE = "days-disagree", "epsilons of single days disagree beyond their sigmas"
    SCALES_INCONSISTENT = (
        "scales-inconsistent",
        "epsilon and the scale of the registration disagree",
    )
    EPSILON_NOT_DETERMINED = (
        "epsilon-not-determined",
        "epsilon is determined by its prior, not by the data",
    )
    EPSILON_NOT_SEPARABLE = (
        "epsilon-not-separable",
        "the data do not separate epsilon from another parameter",
    )
    EPSILON_NOT_SIGNIFICANT = (
        "epsilon-not-significant",
        "epsilon is too small, compared with its sigma, to be applied",
    )
    TERMS_FROM_PRIOR = (
        "terms-from-prior",
        "parameters other than epsilon are determined by their priors",
    )
    UNSOUND_MAPLET = (
        "unsound-maplet",
        "a maplet contradicts its landmark, the shape or the other maplets",
    )
    SPC_ERRORS_CHANGED = (
        "spc-errors-changed",
        "the errors of SPC, on which every fused maplet depends, were estimated again",
    )
    SPC_ERRORS_ASSUMED = (
        "spc-errors-assumed",
        "the lidar has too few heights to determine the errors of SPC, which are assumed",
    )
    LIDAR_COUNTED_TWICE = (
        "lidar-counted-twice",
        "the maplets contain the lidar already, with which they are compared or fused",
    )
    REJECTED_MAPLET = "rejected-maplet", "the registration did not use a maplet that is used here"


class Cause(CodedText):
    """Codes of the reasons why a mapola or the pair of an image is not used."""

    NOT_COVERED = "not-covered", "both surfaces have too little of the grid in common"
    CAPTURE_RANGE = (
        "capture-range",
        "the best match lies at the edge of the capture range",
    )
    NO_RELIEF = "no-relief", "the terrain has too little relief for a match"
    AMBIGUOUS = "ambiguous", "two displacements fit equally well"
    NOT_CONVERGED = "not-converged", "the displacement did not converge"
    FEW_INDEPENDENT = "few-independent", "too few of the differences are independent"
    UNCORRELATED = "uncorrelated", "the surfaces hardly correlate"
    NOT_IN_IMAGES = "not-in-images", "images do not determine the position"
    TYPES_DISAGREE = "types-disagree", "topography and images contradict each other"
    OUTLIER = "outlier", "disagrees with the others"
    NO_TRANSFORM = "no-transform", "there is no transform"
    NO_DATA = "no-data", "there is no scan, return or maplet"
    OUTSIDE_STATES = "outside-states", "the states of the images do not locate the scan"
    OFF_BODY = "off-body", "the central pixel misses the body"
    OBLIQUE = "oblique", "emission or incidence is too large"


@dataclass(frozen=True)
class Finding:
    """One finding about a result.

    Parameters
    ----------
    code : Code
    severity : Severity
    text : str
        What was found, with its numbers and their units: one clause.
    value, limit : float, optional
        The number that was tested and its limit, in the unit of `text`.
    """

    code: Code
    severity: Severity
    text: str
    value: float | None = None
    limit: float | None = None


@dataclass(frozen=True)
class Verdict:
    """All findings about a result, and whether it may be used.

    Parameters
    ----------
    findings : tuple of Finding
    """

    findings: tuple[Finding, ...] = ()

    @property
    def judgement(self) -> Judgement:
        """The judgement that the most severe finding requires."""
        found = {finding.severity for finding in self.findings}
        if Severity.REFUSED in found:
            return "refused"
        return "doubtful" if Severity.DOUBTFUL in found else "accepted"

    def obstacle(self, accepted: Iterable[str]) -> str:
        """Return why the result may not be used, with what to do; empty if it may.

        A doubtful result may be used once each of its codes is among those `accepted`; a refused
        one never.
        """
        refused = [found for found in self.findings if found.severity is Severity.REFUSED]
        fits = [found for found in self.findings if found.code is Code.FITS_OTHERWISE]
        if refused:
            return f"refused: {_listed([*refused, *fits])}"
        named = set(accepted)
        doubtful = [
            found
            for found in self.findings
            if found.severity is Severity.DOUBTFUL and found.code not in named
        ]
        if not doubtful:
            return ""
        codes = " ".join(f"--accept {code}" for code in sorted({found.code for found in doubtful}))
        return f"doubtful: {_listed([*doubtful, *fits])}; look at it, and go on with {codes}"

    def as_json(self) -> dict[str, Any]:
        """Return ``verdict`` and ``findings`` in JSON types."""
        return {
            "verdict": self.judgement,
            "findings": [asdict(finding) for finding in self.findings],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Rebuild from the output of :meth:`as_json`; without ``findings`` there are none.

        Parameters
        ----------
        content : mapping
            As in ``registration.json`` or ``scale.json``.

        Raises
        ------
        ValueError, KeyError
            If a finding has an unknown code or severity, or lacks a field.
        """
        return cls(tuple(_finding(entry) for entry in content.get("findings") or ()))


def _finding(entry: Mapping[str, Any]) -> Finding:
    return Finding(
        Code(entry["code"]),
        Severity(entry["severity"]),
        str(entry["text"]),
        entry.get("value"),
        entry.get("limit"),
    )


def _listed(findings: Sequence[Finding]) -> str:
    return "; ".join(f"{finding.text} [{finding.code}]" for finding in findings)


def verdict_lines(content: Mapping[str, Any]) -> list[str]:
    """Return the verdict and its findings as lines of text; no lines without a verdict.

    Parameters
    ----------
    content : mapping
        As in ``registration.json`` or ``scale.json``.
    """
    if "verdict" not in content:
        return []
    verdict = Verdict.from_json(content)
    return [
        f"verdict: {verdict.judgement}",
        *(f"  {found.severity}: {found.text} [{found.code}]" for found in verdict.findings),
    ]

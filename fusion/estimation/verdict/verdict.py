"""Whether a result may be used: accepted, doubtful or refused, with a code for every reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Literal, Self

Judgement = Literal["accepted", "doubtful", "refused"]
JUDGEMENTS: tuple[Judgement, ...] = ("accepted", "doubtful", "refused")
"""From the best to the worst."""


class Severity(StrEnum):
    """What a finding does to the result: nothing, ask for a person's word, or end its use."""

    NOTE = "note"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


class Code(StrEnum):
    """Codes of findings, as other programs read them; :data:`MEANINGS` has a text for each."""

    CHANGED_INPUT = "changed-input"
    NO_MATCH = "no-match"
    NO_RELIEF = "no-relief"
    RELIEF_UNRELATED = "relief-unrelated"
    FEW_AGREE = "few-agree"
    IMAGES_NOT_MATCHED = "images-not-matched"
    IMAGES_DISAGREE = "images-disagree"
    HEIGHTS_DISAGREE = "heights-disagree"
    CENTERS_DISAGREE = "centers-disagree"
    LARGE_SCALE = "large-scale"
    LARGE_ROTATION = "large-rotation"
    STRAIN = "strain"
    NOT_CONVERGED = "not-converged"
    NOT_DETERMINED = "not-determined"
    WEAKLY_DETERMINED = "weakly-determined"
    FITS_OTHERWISE = "fits-otherwise"
    MAPLET_CONTRADICTED = "maplet-contradicted"
    OUTSIDE_KERNELS = "outside-kernels"
    SCALE_NOT_OBSERVED = "scale-not-observed"
    SCALE_NOT_CONVERGED = "scale-not-converged"
    SHOTS_FIT_ELSEWHERE = "shots-fit-elsewhere"
    SHOTS_FIT_BY_CHANCE = "shots-fit-by-chance"
    SCANS_FIT_ELSEWHERE = "scans-fit-elsewhere"
    SCANS_DISAGREE = "scans-disagree"
    SHOTS_MISS_SHAPE = "shots-miss-shape"
    SCATTER_TOO_LARGE = "scatter-too-large"
    PAIRS_NOT_MATCHED = "pairs-not-matched"
    MANY_REJECTED = "many-rejected"
    EPSILON_BEYOND_PRIOR = "epsilon-beyond-prior"
    CENTRE_BEYOND_PRIOR = "centre-beyond-prior"
    POLE_BEYOND_PRIOR = "pole-beyond-prior"
    MERIDIAN_BEYOND_PRIOR = "meridian-beyond-prior"
    RANGE_BIAS_BEYOND_PRIOR = "range-bias-beyond-prior"
    DAYS_DISAGREE = "days-disagree"
    SCALES_INCONSISTENT = "scales-inconsistent"
    EPSILON_NOT_DETERMINED = "epsilon-not-determined"
    EPSILON_NOT_SEPARABLE = "epsilon-not-separable"
    EPSILON_NOT_SIGNIFICANT = "epsilon-not-significant"
    TERMS_FROM_PRIOR = "terms-from-prior"
    UNSOUND_MAPLET = "unsound-maplet"
    REJECTED_MAPLET = "rejected-maplet"


MEANINGS: Mapping[Code, str] = {
    Code.CHANGED_INPUT: "a file differs from what the stage that wrote it recorded",
    Code.NO_MATCH: "no mapola matches the SPC surface",
    Code.NO_RELIEF: "there is no relief that could show that lidar and SPC are of one ground",
    Code.RELIEF_UNRELATED: "lidar and SPC do not show the same relief where they are put",
    Code.FEW_AGREE: "few mapolas agree with the common transform",
    Code.IMAGES_NOT_MATCHED: "many images do not show the ground that the lidar has there",
    Code.IMAGES_DISAGREE: "images put the lidar's ground elsewhere than its heights do",
    Code.HEIGHTS_DISAGREE: "heights differ by more than their stated sigmas",
    Code.CENTERS_DISAGREE: "centres of maplets are off by more than is stated of them",
    Code.LARGE_SCALE: "the scale lies beyond what two solutions of one body differ by",
    Code.LARGE_ROTATION: "the rotation lies beyond what two solutions of one body differ by",
    Code.STRAIN: "lidar and SPC differ by a shear or a non-uniform scale",
    Code.NOT_CONVERGED: "the fit did not converge",
    Code.NOT_DETERMINED: "the data leave a parameter free",
    Code.WEAKLY_DETERMINED: "a parameter is weakly determined, or not separable from another",
    Code.FITS_OTHERWISE: "the lidar fits the SPC surface in another frame or unit",
    Code.MAPLET_CONTRADICTED: "the lidar contradicts the heights of a maplet",
    Code.OUTSIDE_KERNELS: "returns lie at times that the SPICE kernels do not cover",
    Code.SCALE_NOT_OBSERVED: "fewer than two pairs or shots agree: there is no scale",
    Code.SCALE_NOT_CONVERGED: "the fit of the scale did not converge",
    Code.SHOTS_FIT_ELSEWHERE: "shots fit the shape better turned or mirrored than as they are",
    Code.SHOTS_FIT_BY_CHANCE: "shots fit the shape as well at a place that is a wrong one",
    Code.SCANS_FIT_ELSEWHERE: "scans fit the shape better turned or mirrored, each on its own",
    Code.SCANS_DISAGREE: "scans over the same ground differ by more than shots of one scan do",
    Code.SHOTS_MISS_SHAPE: "many shots do not meet the shape",
    Code.SCATTER_TOO_LARGE: "residuals scatter far more than the sigmas say",
    Code.PAIRS_NOT_MATCHED: "the surfaces of many pairs could not be matched",
    Code.MANY_REJECTED: "many pairs or shots disagree with the rest",
    Code.EPSILON_BEYOND_PRIOR: "epsilon is far larger than its prior",
    Code.CENTRE_BEYOND_PRIOR: "the centre is far beyond its prior",
    Code.POLE_BEYOND_PRIOR: "the pole is far beyond its prior",
    Code.MERIDIAN_BEYOND_PRIOR: "the prime meridian is far beyond its prior",
    Code.RANGE_BIAS_BEYOND_PRIOR: "the range bias is far beyond its prior",
    Code.DAYS_DISAGREE: "epsilons of single days disagree beyond their sigmas",
    Code.SCALES_INCONSISTENT: "epsilon and the scale of the registration disagree",
    Code.EPSILON_NOT_DETERMINED: "the data leave epsilon to its prior",
    Code.EPSILON_NOT_SEPARABLE: "the data do not tell epsilon from another parameter",
    Code.EPSILON_NOT_SIGNIFICANT: "epsilon is too small for its sigma to be applied",
    Code.TERMS_FROM_PRIOR: "parameters other than epsilon are left to their priors",
    Code.UNSOUND_MAPLET: "a maplet contradicts its landmark, the shape or the other maplets",
    Code.REJECTED_MAPLET: "the registration did not use a maplet that is used here",
}
"""What each code means, for people."""


@dataclass(frozen=True)
class Finding:
    """One thing that was found about a result.

    Parameters
    ----------
    code : Code
    severity : Severity
    text : str
        What was found, with its numbers and their units: one clause.
    value, limit : float, optional
        The number that was tested and what it was tested against, in the unit of `text`.
    """

    code: Code
    severity: Severity
    text: str
    value: float | None = None
    limit: float | None = None


@dataclass(frozen=True)
class Verdict:
    """All that was found about a result, and what follows for its use.

    Parameters
    ----------
    findings : tuple of Finding
    """

    findings: tuple[Finding, ...] = ()

    @property
    def judgement(self) -> Judgement:
        """The worst of the findings decides."""
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
        """Rebuild from what :meth:`as_json` gave; a result without ``findings`` has none.

        Raises
        ------
        ValueError, KeyError
            If a finding is not understood: it is not passed over.
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
    """Return what people read first of a result that has a verdict; nothing if it has none."""
    if "verdict" not in content:
        return []
    verdict = Verdict.from_json(content)
    return [
        f"verdict: {verdict.judgement}",
        *(f"  {found.severity}: {found.text} [{found.code}]" for found in verdict.findings),
    ]

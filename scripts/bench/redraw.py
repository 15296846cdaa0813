"""How likely the errors of one mission's scale are, by drawing the planted errors again.

For a mission and its workspace (scans imported) three tables are printed:

- *causes*: the effect of each planted error on the centre, along x, y and z. The estimate is
  linear in the observations (`fusion.estimation.leverage`), so the parts add up to the whole error.
  Next to each are its standard deviation over all draws, and the ratio of the two. "matches" is the
  rest: the effect of the noise of heights on the matches of pairs.
- *redraws*: the same geometry with all planted errors drawn again, and estimated by the program,
  with error sizes and robust weights. Errors of matches are drawn from their covariances. For
  each parameter the rms of the pulls, their excess kurtosis, the shares beyond two and three, the
  largest, and how likely a pull as large as this mission's is: error and stated sigma are
  independent for normal errors, so it is the mean over the redraws of 2 Φ(−|pull| σ / s), s the
  standard deviation of the errors.
- *states*: with `--again N`, pairs are made and matched again with the states that the seeds
  2 … N + 1 draw for this mission; next to the pulls the shift that the linear influence predicts.

A redraw of `mini` takes a second and a half, a new set of pairs a quarter of a minute.

    python scripts/bench/redraw.py MISSION=WORKSPACE [--draws 400] [--again 0]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scale_limits import Case, observed
from scipy.stats import kurtosis, norm

from fusion.estimation import influence
from fusion.runtime import Progress, ThreadExecutor
from fusion.scaling.fit import ScaleEstimate, estimate_scale
from fusion.scaling.fit.groups import pointing_of_scans
from fusion.scaling.fit.observation import PARAMETERS, uniform_displacements
from fusion.scaling.pairs import pair_maplet_shares, pair_observations
from fusion.truth.generation import Site
from fusion.truth.planted import Planted
from fusion.truth.solution import plan_states
from fusion.truth.work import Work
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.navigation import et_from_utc
from spcola.truth.body import stream
from spcola.truth.campaign import plan_passes

CENTER = slice(1, 4)


@dataclass(frozen=True)
class OtherStates(Workspace):
    """A workspace whose images have other states."""

    solved: dict[str, SpcImage] = field(kw_only=True)

    def image(self, name: str) -> SpcImage:
        """Read the image `name`, with the other state."""
        other = self.solved[name]
        return replace(super().image(name), scobj=other.scobj, axes=other.axes)


class Redraws:
    """The pairs of a mission, its planted errors, and other possible ones."""

    def __init__(self, case: Case) -> None:
        self.case, self.planted = case, case.planted
        self.made = case.pairing(case.workspace)
        self.observations = observed(self.made, self.made.pairs)
        self.estimate = estimate_scale(self.observations)
        self.influence = influence(self.estimate.equations, self.estimate.fit)
        self.true = true_parameters(self.planted)

    def causes(self) -> Iterator[tuple[str, FloatArray, FloatArray]]:
        """Yield the parts of the centre's error and their standard deviations, both (3,)."""
        settings = self.planted.settings
        seen = self.observations
        states = self._state_partials() @ self._state_errors(self.case.workspace).ravel()
        centers = -pair_maplet_shares(self.made.pairs) @ self._center_errors()
        parts = {
            "states of images": (states, self._state_partials(), settings.states.position_sigma),
            "pointing of scans": (
                self.case.aside(seen), pointing_of_scans(seen), settings.lidar.pointing_sigma,
            ),
            "centres of maplets": (
                centers,
                uniform_displacements(pair_maplet_shares(self.made.pairs)),
                settings.solution.center_sigma,
            ),
            "ranges of days": (self.case.longer(seen), np.zeros((len(seen), 3, 1)), 0.0),
        }  # fmt: skip
        known = seen.design() @ self.true
        for name, (displaced, sources, size) in parts.items():
            known = known + displaced
            yield name, self._moved(displaced), size * self._spread(sources)
        patterns, own = self._matches()
        spread = np.hypot(self._spread(patterns), self._spread_alone(own))
        yield "matches", self._moved(seen.value - known), spread

    def redrawn(self, generator: np.random.Generator) -> ScaleEstimate:
        """Estimate the scale from observations with all random errors drawn again."""
        settings, seen = self.planted.settings, self.observations
        patterns, own = self._matches()
        sources = (
            (self._state_partials(), settings.states.position_sigma),
            (pointing_of_scans(seen), settings.lidar.pointing_sigma),
            (
                uniform_displacements(pair_maplet_shares(self.made.pairs)),
                settings.solution.center_sigma,
            ),
            (patterns, 1.0),
        )
        value = seen.design() @ self.true + self.case.longer(seen)
        for displaced, size in sources:
            value = value + displaced @ (size * generator.normal(size=displaced.shape[2]))
        alone = np.linalg.cholesky(own) @ generator.normal(size=(*seen.value.shape, 1))
        return estimate_scale(replace(seen, value=value + alone[..., 0]))

    def again(self, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pair again with the states that `seed` draws: error, sigma and predicted error (3,)."""
        other = OtherStates(self.case.workspace.root, solved=drawn_states(self.planted, seed))
        made = self.case.pairing(other)
        fit = estimate_scale(observed(made, made.pairs)).fit
        change = self._state_errors(other) - self._state_errors(self.case.workspace)
        error = self.estimate.fit.estimate - self.true
        predicted = error[CENTER] + self._moved(self._state_partials() @ change.ravel())
        return (fit.estimate - self.true)[CENTER], fit.sigma[CENTER], predicted

    def _state_partials(self) -> FloatArray:
        """Return the partials (N, 3, 3 S) of observations by displacements of the states."""
        response = self.observations.response
        assert response is not None
        return response

    def _state_errors(self, workspace: Workspace) -> FloatArray:
        """Errors (S, 3) of the positions of a workspace's images, in order of time, metres."""
        images = sorted(workspace.images(), key=lambda image: et_from_utc(image.utc))
        true = np.array([self.planted.images[image.name].position_m for image in images])
        errors: FloatArray = np.array([image.position for image in images])
        return errors - self.planted.similarity.apply(true)

    def _center_errors(self) -> FloatArray:
        """Errors (M, 3) of the maplets' centres, metres."""
        centers = [self.planted.centers[name] for name in self.made.maplets]
        true = np.array([center.true_center for center in centers])
        errors: FloatArray = np.array([center.center_m for center in centers])
        return errors - self.planted.similarity.apply(true)

    def _matches(self) -> tuple[FloatArray, FloatArray]:
        """Errors of matches: patterns (N, 3, K) that pairs share, and covariances (N, 3, 3)."""
        alone = pair_observations(self.made.pairs, "spc")
        assert alone.ground is not None
        return alone.ground, alone.covariance

    def _moved(self, displaced: FloatArray) -> FloatArray:
        """Return the effect of displacements (N, 3) of observations on the centre (3,), metres."""
        moved: FloatArray = np.einsum("pnd,nd->p", self.influence[CENTER], displaced)
        return moved

    def _spread(self, sources: FloatArray) -> FloatArray:
        """Return the standard deviation (3,) of the centre for unit sources (N, 3, R)."""
        return np.linalg.norm(np.einsum("pnd,ndr->pr", self.influence[CENTER], sources), axis=1)

    def _spread_alone(self, covariance: FloatArray) -> FloatArray:
        """Return the standard deviation (3,) of the centre for errors of single observations."""
        rows = self.influence[CENTER]
        return np.sqrt(np.einsum("pnd,nde,pne->p", rows, covariance, rows))


def true_parameters(planted: Planted) -> FloatArray:
    """Planted values (8,) in the order of :data:`PARAMETERS`."""
    turn, bias = np.radians(planted.settings.rotation_deg), planted.settings.lidar.range_bias
    return np.array([planted.epsilon, 0.0, 0.0, 0.0, *turn, bias])


def drawn_states(planted: Planted, seed: int) -> dict[str, SpcImage]:
    """Solved states of the images of a mission as the generator draws them for another seed."""
    settings = replace(planted.settings, seed=seed)
    passes = plan_passes(settings.passes, stream(planted.settings.seed, "passes"))
    silent = Progress.fitting(silent=True)
    work = Work(settings, Site(Path()), planted.body(), ThreadExecutor(1), silent)
    return {state.solved.name: state.solved for state in plan_states(work, passes)}


def print_causes(redraws: Redraws) -> None:
    """Print the parts of the centre's error; the last row is their sum."""
    print(f"\n{'error of the centre, cm':24}" + "".join(f"{axis:>22}" for axis in "xyz"))
    total, variance = np.zeros(3), np.zeros(3)
    for name, part, spread in redraws.causes():
        total, variance = total + part, variance + spread**2
        print(f"{name:24}" + "".join(_cell(*pair) for pair in zip(part, spread, strict=True)))
    spread = np.sqrt(variance)
    print(f"{'all':24}" + "".join(_cell(*pair) for pair in zip(total, spread, strict=True)))
    stated = redraws.estimate.fit.sigma[CENTER]
    print(f"{'stated':24}" + "".join(_cell(*pair) for pair in zip(total, stated, strict=True)))


def _cell(part: float, spread: float) -> str:
    ratio = f"{part / spread:+.2f}" if spread else ""
    return f"{100 * part:>+8.2f} ±{100 * spread:5.2f} {ratio:>6}"


def print_redraws(redraws: Redraws, count: int) -> None:
    """Print the statistics of the pulls over `count` redraws."""
    generator = np.random.default_rng(1)
    fits = [redraws.redrawn(generator).fit for _ in range(count)]
    errors = np.array([fit.estimate for fit in fits]) - redraws.true
    sigmas = np.array([fit.sigma for fit in fits])
    fit = redraws.estimate.fit
    here = (fit.estimate - redraws.true) / fit.sigma
    print(f"\n{count} redraws; rms pull ± {np.sqrt(0.5 / count):.2f}", end="")
    print(f", kurtosis ± {np.sqrt(24 / count):.2f}; size of states: ", end="")
    sizes = np.array([fit.sizes.shared[0] for fit in fits])
    print(f"{100 * np.median(sizes):.1f} cm (median), here {100 * fit.sizes.shared[0]:.1f} cm")
    print(
        f"{'parameter':14}{'rms pull':>9}{'kurtosis':>9}{'> 2':>7}{'> 3':>7}{'largest':>9}"
        f"{'here':>7}{'chance':>9}"
    )
    for column, name in enumerate(PARAMETERS):
        pulls = errors[:, column] / sigmas[:, column]
        ratio = sigmas[:, column] / np.std(errors[:, column])
        chance = float(np.mean(2.0 * norm.sf(abs(here[column]) * ratio)))
        print(
            f"{name:14}{np.sqrt(np.mean(pulls**2)):>9.2f}{kurtosis(pulls):>+9.2f}"
            f"{np.mean(abs(pulls) > 2):>7.3f}{np.mean(abs(pulls) > 3):>7.3f}"
            f"{abs(pulls).max():>9.2f}{here[column]:>+7.2f}{chance:>9.1e}"
        )


def print_again(redraws: Redraws, count: int) -> None:
    """Print centres of pairs made again with other states, and predictions by the influence."""
    print("\nstates of other seeds, pairs made anew: error of the centre, cm; its pulls; predicted")
    found = []
    for seed in range(2, count + 2):
        error, sigma, predicted = redraws.again(seed)
        found.append((error, error / sigma, predicted))
        print(f"  {seed:3}   {100 * error}   {error / sigma}   {100 * predicted}", flush=True)
    errors, pulls, predicted = (np.array(column) for column in zip(*found, strict=True))
    off = 100 * np.sqrt(np.mean((errors - predicted) ** 2))
    print(f"rms pull {np.sqrt(np.mean(pulls**2)):.2f}; predicted within {off:.2f} cm (rms)")


def main() -> None:
    parser = argparse.ArgumentParser(description="How likely the errors of a mission's scale are.")
    parser.add_argument("case", help="MISSION=WORKSPACE")
    parser.add_argument("--draws", type=int, default=400)
    parser.add_argument("--again", type=int, default=0, help="sets of states with pairs made anew")
    options = parser.parse_args()
    mission, workspace = (Path(part) for part in options.case.split("=", 1))
    np.set_printoptions(precision=2, suppress=True, sign="+")
    redraws = Redraws(Case(mission, workspace))
    print_causes(redraws)
    if options.draws:
        print_redraws(redraws, options.draws)
    if options.again:
        print_again(redraws, options.again)


if __name__ == "__main__":
    main()

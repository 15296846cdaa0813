"""Answers about workspaces: overview, lists, results, solutions, runs and provenance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, RootModel, create_model

from fusion.registration.results.keys import REGISTRATION_KEYS
from fusion.scaling.results.keys import SCALE_KEYS
from fusion.service.api.schemas.base import Form, Media, Number, Open, form_of, listing
from fusion.service.api.schemas.surfaces import Grid
from fusion.service.views.tables import TableFormat
from fusion.workspace.solution_records import SolutionRecord

FILE = Media(("*/*",), {"Accept-Ranges": "bytes: a range may be asked for."})


class Finding(Open):
    """What a stage found, with its code."""

    stage: str
    code: str
    text: str


class RegistrationHead(Form):
    """The registration in short."""

    model: str | None
    scale: Number
    scale_sigma: Number
    n_used: int | None
    n_rejected: int | None
    verdict: str | None


class ScaleHead(Form):
    """The scale in short."""

    epsilon: Number
    epsilon_sigma: Number
    size_correction_m: Number
    size_correction_sigma_m: Number
    n_used: int | None
    n_rejected: int | None
    verdict: str | None


class MainResults(Form):
    """The main results; null where there is none yet."""

    registration: RegistrationHead | None
    scale: ScaleHead | None


class Overview(Form):
    """Counts, stages and their state, main results, and problems of a workspace."""

    name: str
    kind: Literal["workspace"]
    body: str
    solution: str
    maplets: int
    landmarks: int
    images: int
    line_scans: int
    images_in_catalogue: int
    shape: str
    scans: int
    returns: int
    mapolas: int
    fused: int
    import_memory_per_worker_mb: float
    import_memory_mb: float
    stages: dict[str, str]
    problems: list[str]
    finished: dict[str, str]
    images_not_used: dict[str, Any]
    bigmaps: int
    pairs: int
    released: int
    verdicts: dict[str, str]
    findings: list[Finding]
    results: MainResults


class WorkspaceName(Form):
    """A workspace that may be read."""

    name: str


class Damaged(Form):
    """An item of a list that cannot be read, and why."""

    name: str
    problem: str


class ScanItem(Form):
    """A scan."""

    name: str
    scan: str
    returns: int
    rejected: dict[str, int]
    first_et_s: Number
    last_et_s: Number
    first_utc: str | None
    last_utc: str | None
    trajectory: str
    body: str
    lowest_m: list[Number]
    highest_m: list[Number]
    digest: str


class ImageItem(Open):
    """An image: the facts of its .SUM file, where it was taken, whether there are pixels."""

    name: str
    kind: str
    longitude_deg: float
    latitude_deg: float
    radius_m: float
    has_pixels: bool


class MapItem(Grid):
    """A maplet or a fused maplet."""

    name: str


class MapolaItem(Grid):
    """A mapola: its frame, the covered part of its cells, and its returns."""

    name: str
    coverage: Number
    returns: int


class BigmapItem(Grid):
    """A site, and its bigmaps."""

    name: str
    surfaces: list[str]


class PairItem(Open):
    """An image with bigmaps of SPC and lidar, and what the scale has on it."""

    name: str
    surfaces: list[str]


def _list(key: str, item: Any) -> Any:
    return listing(key, item | Damaged, total=int)


LISTS: Mapping[str, Any] = {
    "scans": _list("scans", ScanItem),
    "images": _list("images", ImageItem),
    "maplets": _list("maplets", MapItem),
    "mapolas": _list("mapolas", MapolaItem),
    "fused": _list("fused", MapItem),
    "bigmaps": _list("bigmaps", BigmapItem),
    "pairs": _list("pairs", PairItem),
}
WORKSPACES = listing("workspaces", WorkspaceName)


def _keys(name: str, about: str, keys: Mapping[str, str]) -> Any:
    """Return the model of a file of results: what its keys mean; which it has is its method's."""
    plain = {key: text for key, text in keys.items() if "." not in key}
    content: dict[str, Any] = {key: (Any, Field(None, description=plain[key])) for key in plain}
    return create_model(name, __base__=Open, __doc__=about, **content)


class Product(Open):
    """A file of the release, and what it was made from."""

    file: str
    kind: str
    maplet: str
    sha256: str
    bytes: int
    made_from: dict[str, str]


class Manifest(Open):
    """The manifest of the release."""

    format: str
    body: str
    versions: dict[str, str]
    settings: dict[str, Any]
    made_from: dict[str, str]
    products: list[Product]


REGISTRATION: Any = _keys("Registration", "registration.json", REGISTRATION_KEYS)
SCALE: Any = _keys("Scale", "scale.json", SCALE_KEYS)


class Result(RootModel[REGISTRATION | SCALE | Manifest]):
    """The content of registration.json, scale.json or the manifest of the release."""


class Match(Form):
    """A mapola on its maplet; residuals are null where it does not match."""

    name: str
    sigma_m: list[Number] | None = None
    used: bool | None = None
    cause: str | None = None
    reason: str | None = None
    correlation: Number = None
    coverage: Number = None
    n_images: int | None = None
    longitude_deg: Number
    latitude_deg: Number
    radius_m: Number
    residual_m: list[Number]
    residual_east_m: Number
    residual_north_m: Number
    residual_up_m: Number
    size_m: Number


class Residuals(Form):
    """The matches of the registration."""

    model: str | None
    verdict: str | None
    n_used: int | None
    n_rejected: int | None
    matches: list[Match]


class Single(Form):
    """Values of pairs or shots, as columns."""

    at: list[Number]
    epsilon: list[Number]
    epsilon_sigma: list[Number]
    used: list[bool]


class Bins(Form):
    """Means, as columns."""

    at: list[Number]
    epsilon: list[Number]
    standard_error: list[Number]


class Against(Form):
    """Values of ε against an angle or a time, and means in bins of it."""

    single: Single
    bins: Bins


class Epsilon(Form):
    """ε with its sigma: of all, per day, by local time and by longitude."""

    epsilon: Number
    epsilon_sigma: Number
    method: str | None
    verdict: str | None
    trends: dict[str, Any] | None
    reasons: list[str] | None
    per_day: list[dict[str, Any]]
    local_time_h: Against
    longitude_deg: Against


class Table(Form):
    """A table, by columns."""

    name: str
    rows: int
    columns: dict[str, list[Any]]


TABLE = Media(
    tuple(form.value for form in TableFormat), {"ETag": "Digest of the table."},
    {"application/json": Table.model_json_schema(), "text/csv": {"type": "string"}},
)  # fmt: skip
TABLES = listing("tables", str)
SOLUTION: Any = form_of(SolutionRecord, name="Solution")
SOLUTIONS = listing("solutions", SOLUTION, in_use=str, problems=list[str])
ONE_SOLUTION = form_of(
    SolutionRecord, name="SolutionContent",
    folder=str, maplets=int, landmarks=int, images=int, line_scans=int,
)  # fmt: skip


class Percentiles(Form):
    """Percentiles of what changed; null where nothing can be compared."""

    p50: Number
    p95: Number
    p100: Number


class SolutionDifference(Form):
    """How the second solution differs from the first."""

    first: str
    second: str
    maplets: int
    images: int
    only_first: list[str]
    only_second: list[str]
    centers_moved_m: Percentiles | None
    centers_outward_m: Percentiles | None
    centers_left_over_m: Percentiles | None
    heights_changed_m: Percentiles | None
    heights_compared: int
    positions_moved_m: Percentiles | None
    cameras_changed_px: Percentiles | None
    pointing_turned_deg: Percentiles | None
    common_scale: Number
    common_rotation_deg: list[Number] | None
    common_shift_m: list[Number] | None
    shape_radius_ratio: Number
    constants: dict[str, list[Any]]


class RunHead(Form):
    """The last run of a stage in a solution."""

    id: str
    solution: str
    stage: str
    finished: str
    version: str
    key: str
    settings_digest: str


class RunItem(RunHead):
    """A run in the list; `inputs` and `outputs` are counted."""

    verdict: str | None
    inputs: int
    outputs: int


class Reproduction(Form):
    """The job that reproduces a run."""

    kind: Literal["run"]
    parameters: dict[str, Any]


class Run(RunHead):
    """A run with its settings, summary, and digests by file."""

    settings: dict[str, Any]
    summary: dict[str, Any]
    inputs: dict[str, str]
    outputs: dict[str, str]
    request: Reproduction


class RunDifference(Form):
    """What differs between two runs: both values by key, null where one lacks it."""

    first: str
    second: str
    same: bool
    settings: dict[str, list[Any]]
    results: dict[str, list[Any]]
    inputs: dict[str, list[str | None]]
    outputs: dict[str, list[str | None]]


class Node(Open):
    """A file, a group of files, or a run."""

    id: str
    type: Literal["file", "group", "run"]


class Provenance(Form):
    """What a file was made from: edges lead from what was made to what it was made from."""

    nodes: list[Node]
    edges: list[tuple[str, str]]
    solutions: list[SOLUTION]


RUNS = listing("runs", RunItem)

"""States of stages after results changed: from the digests of these files alone, or found anew."""

from __future__ import annotations

import json
from contextlib import closing

import numpy as np
import pytest

from fusion.pipeline.catalog import Catalog
from fusion.pipeline.standing import FileRoles, Standing, standings_after
from fusion.workspace import Workspace

from .conftest import Copy, pipeline

RESULTS = [f"{place}/{name}.txt" for place in ("first", "second", "third") for name in "ab"]


def found_anew(workspace: Workspace, stages: list[Copy]) -> tuple[list[Standing], FileRoles]:
    with closing(Catalog(workspace, read_only=True)) as catalog:
        standings = pipeline(workspace, stages).standings(catalog)
        records = catalog.records()
    return list(standings.values()), FileRoles.of_stages(
        {record.stage: record.inputs for record in records},
        {record.stage: record.outputs for record in records},
    )


def digest(workspace: Workspace, name: str) -> str:
    with closing(Catalog(workspace, read_only=True)) as catalog:
        return catalog.digest(workspace.path_of(name))


@pytest.mark.parametrize("seed", range(3))
def test_after_any_changes_of_results_stages_stand_as_if_looked_at_again(
    workspace: Workspace, stages: list[Copy], seed: int
) -> None:
    pipeline(workspace, stages).run()
    first = {name: workspace.path_of(name).read_text() for name in RESULTS}
    # One stage stands apart: it would run with another version.
    stages[seed % 3].version += seed
    standings, roles = found_anew(workspace, stages)
    rng = np.random.default_rng(seed)
    for _ in range(12):
        changes = []
        for name in rng.permutation(RESULTS)[: rng.integers(1, 4)].tolist():
            before = digest(workspace, name)
            # Back to what it was, or to one of three other contents.
            text = str(rng.choice([first[name], "one", "two", "three"]))
            workspace.path_of(name).write_text(text)
            changes.append((name, before, digest(workspace, name)))
        # What is kept between two looks is kept as JSON.
        kept = [Standing.from_json(json.loads(json.dumps(one.as_json()))) for one in standings]
        read_again = FileRoles.from_json(json.loads(json.dumps(roles.as_json())))
        after = standings_after(kept, read_again, changes)
        standings, roles = found_anew(workspace, stages)
        assert after == standings
        assert {one.stage: one.state for one in standings} == pipeline(workspace, stages).states()


def test_a_file_that_no_stage_wrote_may_mean_more_than_its_digest(
    workspace: Workspace, stages: list[Copy]
) -> None:
    pipeline(workspace, stages).run()
    standings, roles = found_anew(workspace, stages)
    for name in ("raw/a.txt", "none.txt"):
        assert standings_after(standings, roles, [(name, "one", "two")]) is None

"""What the bench that kills the service counts as finished."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from scripts.bench.service.kills import Bench


def test_a_file_that_is_being_written_is_no_finished_item(tmp_path: Path) -> None:
    bench = Bench(tmp_path, Namespace(seed=1))
    root = bench.served.folder / "states"
    there = ["IMAGEFILES/a.DAT", "MAPFILES/A00001.MAP", "scans/one.h5", ".items/fuse/ab.npz"]
    under_way = ["IMAGEFILES/.b.DAT.d0b4.part", "SUMFILES/.b.SUM.d0b4.part", ".items/fuse/.c.npz"]
    for name in (*there, *under_way):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"made up")
    assert sorted(bench._items("states")) == sorted(there)

"""Files that belong together, sent to a real server: labels, pixels, ISD files."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import called
from server_process import ServerProcess

from fusion.client import Session
from fusion.service.commands.images import companions_of
from fusion.service.jobs import JobKind
from fusion.stages.images import StateChoice, StateKind
from fusion.stages.images.candidates import images_among
from fusion.workspace import new_workspace
from spcola.errors import InvalidValueError
from spcola.formats.images import read_image_data

DATA = Path(__file__).parents[4] / "shared" / "data"
EROS = DATA / "eros" / "m0126360726f4_2p_cif_gbl.fit"
PIXELS = np.add.outer(np.arange(30), np.arange(40) * 2).astype(np.uint8)
LABEL = """PDS_VERSION_ID = PDS3
RECORD_TYPE = FIXED_LENGTH
RECORD_BYTES = 40
FILE_RECORDS = 30
^IMAGE = "PIXELS{0}.IMG"
START_TIME = 2000-02-19T08:54:5{0}.913
EXPOSURE_DURATION = 998.0 <ms>
OBJECT = IMAGE
  LINES = 30
  LINE_SAMPLES = 40
  SAMPLE_BITS = 8
  SAMPLE_TYPE = MSB_UNSIGNED_INTEGER
END_OBJECT = IMAGE
END
"""


def detached(folder: Path, number: int) -> tuple[Path, Path]:
    """Write a label and the pixels that it names, which have another stem; return both."""
    label, pixels = folder / f"frame{number}.lbl", folder / f"pixels{number}.img"
    label.write_text(LABEL.format(number))
    pixels.write_bytes((PIXELS + np.uint8(number)).tobytes())
    return label, pixels


@pytest.fixture(scope="module")
def place(missions: Path) -> str:
    """The name of a workspace for images on the server."""
    return new_workspace(missions / "views", body="Ball").root.name


def brought(session: Session, job: object) -> list[dict]:
    done = session.wait(job, progress=False)
    assert done.error is None, done.error
    return list(done.result["new"])


def test_a_label_and_its_pixels_come_together(
    remote: Session, server: ServerProcess, missions: Path, place: str, tmp_path: Path
) -> None:
    pairs = [detached(tmp_path, number) for number in range(4)]
    # A label alone, and both in either order.
    files = [pairs[0][0], *pairs[1], *reversed(pairs[2])]
    new = brought(remote, remote.import_images(place, files, progress=False))
    new += called("--server", server.url, "images", place, pairs[3][0])["new"]
    assert len(new) == 4
    # The pixels of the first and the last are companions; no upload is needed any more.
    camera = remote.upload(place, pairs[0][0], "camera", name="kept.toml", progress=False)
    size = 4 * (PIXELS.size + len(LABEL.format(0)))
    assert remote.remove_imported_uploads(place) == {"removed": 8, "bytes": size}
    assert [one["id"] for one in remote.uploads(place)] == [camera]
    assert remote.remove_imported_uploads(place)["removed"] == 0
    for number, one in enumerate(new):
        assert one["size"] == [40, 30]
        written = read_image_data(missions / place / "IMAGEFILES" / f"{one['name']}.DAT", 40, 30)
        np.testing.assert_array_equal(written, PIXELS + number)


def test_two_of_one_name_are_refused_when_the_job_is_submitted(
    remote: Session, place: str, tmp_path: Path
) -> None:
    files = detached(tmp_path, 0)
    sent = [remote.upload(place, file, "image", name="one.img", progress=False) for file in files]
    with pytest.raises(InvalidValueError, match=r"one\.img: is the name of two files of the jo"):
        remote.submit_job(place, JobKind.IMAGES, {"uploads": sent[:1], "companions": sent[1:]})


@pytest.mark.real_data
@pytest.mark.skipif(not EROS.is_file(), reason="../shared is not there")
def test_a_real_image_by_its_label(remote: Session, missions: Path, tmp_path: Path) -> None:
    workspace = new_workspace(missions / "eros", body="Eros").root.name
    for ending in (".xml", ".fit"):
        shutil.copy(EROS.with_suffix(ending), tmp_path)
    label = tmp_path / EROS.with_suffix(".xml").name
    (one,) = brought(remote, remote.import_images(workspace, [label], progress=False))
    assert one["label"]["format"] == "pds4"
    assert one["label"]["mid_utc"].startswith("2000 FEB 19")


def test_isd_files_are_companions_and_no_images(tmp_path: Path) -> None:
    image, isd = tmp_path / "a.fit", tmp_path / "a.json"
    image.write_bytes(b"")
    isd.write_text(json.dumps({}))
    assert companions_of([image], isd=True) == [isd]
    assert companions_of([image]) == companions_of([image, isd], isd=True) == []
    by_isd = StateChoice(StateKind.ISD)
    assert images_among([isd, image], by_isd) == [image]
    with pytest.raises(InvalidValueError, match="ISD file of no image"):
        images_among([tmp_path / "b.json", image], by_isd)

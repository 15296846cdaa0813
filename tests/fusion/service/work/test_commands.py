"""Every command that writes can be a job, with the same result to the bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer
from astropy.io import fits
from command_line import app, called
from damage import files_in
from distributed import LocalCluster
from served import Service
from star_cruise import Cruise, check_calibration

from fusion.pipeline.solutions import MadeBy, making_solution, remove_solution
from fusion.service.commands.table import COMMANDS
from fusion.service.jobs import Job, JobKind, JobState
from fusion.service.views.history import run_record, run_request, runs_compared
from fusion.service.work.parameters import EXAMPLES, PARAMETERS, parameters_of
from fusion.stages.images.catalogue import read_catalogue
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from fusion.workspace.settings import Settings, write_settings
from spcola.camera import Camera
from spcola.camera.instrument import Instrument
from spcola.errors import InvalidValueError
from spcola.formats.cameras import write_cameras
from spcola.navigation import Spin, et_from_utc, utc_from_et

SPIN = Spin(85.45, -60.37, 140.69, 2011.15)
START = et_from_utc("2019-03-03T10:59:40.279")
READING = {
    "align", "demo", "run", "solution list", "solution show",
    "truth make", "init",
    "serve start", "serve worker", "serve backup", "serve restore",
    "job list", "job show", "job wait", "job cancel", "download", "serve settings",
    "serve token add", "serve token list", "serve token revoke",
}  # fmt: skip
"""Commands that write to no workspace, or whose jobs have parameters of their own."""
STAGES = {"mapolas", "register", "fuse", "bigmap", "scale", "release", "report"}


def commands_of(group: typer.Typer, prefix: str = "") -> set[str]:
    found = {f"{prefix}{one.name}" for one in group.registered_commands}
    for one in group.registered_groups:
        assert one.typer_instance is not None
        found |= commands_of(one.typer_instance, f"{prefix}{one.typer_instance.info.name} ")
    return found


def test_every_command_that_writes_has_a_kind() -> None:
    # `fuse` is a stage, and with --from images a kind of its own.
    by_table = {one.name for one in COMMANDS.values()} - {"fuse --from images"}
    assert commands_of(app) - READING - STAGES == by_table
    assert {*COMMANDS, JobKind.RUN, JobKind.FORECAST, JobKind.SCALE_APPLY, JobKind.INIT} == {
        *JobKind
    }


def test_the_example_of_each_kind_is_one() -> None:
    assert PARAMETERS.keys() == EXAMPLES.keys() == {*JobKind}
    for kind, given in EXAMPLES.items():
        parameters_of(kind, given)


@pytest.mark.parametrize(
    ("kind", "given", "text"),
    [
        (JobKind.RUN, {"stages": ["maplas"]}, "use ingest, mapolas, register"),
        (JobKind.KERNELS, {"out": "../kernels"}, "out"),
        (JobKind.KERNELS, {"out": ".hidden"}, "out"),
        (JobKind.KERNELS, {"out": "k", "max_gap_s": float("nan")}, "max_gap_s"),
        (JobKind.IMAGES, {"uploads": ["a"], "dark": {"output": "a/../b"}}, "dark"),
        (JobKind.IMAGES, {"uploads": ["/etc/passwd"]}, "uploads"),
        (JobKind.IMPORT, {"uploads": ["a"], "colums": {}}, "colums"),
        (JobKind.LOOK, {"out": "../a.png"}, "out"),
    ],
)
def test_what_no_command_takes_is_refused(kind: JobKind, given: dict, text: str) -> None:
    with pytest.raises(InvalidValueError, match=text.replace("/", ".")):
        parameters_of(kind, given)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Three images with labels, their poses, a camera and a dark frame, by name."""
    folder = tmp_path_factory.mktemp("given")
    camera = Camera(20.0, [8.5, 8.5], [[100.0, 0, 0], [0, -100.0, 0]], 16, 16)
    write_cameras(folder / "nac.toml", [Instrument("NAC", camera, None, None, None)])
    rng = np.random.default_rng(4)
    lines = ["image,utc,v0x_m,v0y_m,v0z_m,cxx,cxy,cxz,cyx,cyy,cyz,czx,czy,czz,sunx,suny,sunz"]
    for number in range(3):
        utc = utc_from_et(START + 60.0 * number)
        frame = fits.PrimaryHDU(rng.integers(100, 4000, (16, 16)).astype(np.uint16))
        frame.header["DATE-OBS"] = utc
        frame.writeto(folder / f"n{number}.fit")
        values = [4000.0 + number, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 1.0, 0, 0, 0.6, 0.8, 0]
        lines.append(",".join([f"n{number}", utc, *map(str, values)]))
    fits.PrimaryHDU(np.full((16, 16), 40, np.uint16)).writeto(folder / "dark.fit")
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def workspace_at(root: Path) -> Path:
    """Make a workspace whose body turns."""
    made = new_workspace(root, body="Ball")
    pole = {"pole_ra_deg": 85.45, "pole_dec_deg": -60.37, "meridian_deg": 140.69}
    settings = Settings().with_table("spin", **pole, rate_deg_per_day=2011.15)
    settings = settings.with_table("spice", spacecraft="-64", body=2101955)
    write_settings(root / SETTINGS_FILE, settings.with_table("body", name="Ball"))
    return made.root


def finished(service: Service, job: Job) -> dict:
    """Return the result of a job, in JSON."""
    done = service.store.job(job.id)
    assert done.state is JobState.FINISHED, done.error
    return json.loads(json.dumps(done.result))


def test_images_states_kernels_and_exports(
    service: Service, given: dict[str, bytes], tmp_path: Path
) -> None:
    by_hand, files = tmp_path / "hand" / "new", tmp_path / "hand" / "files"
    files.mkdir(parents=True)
    for name, content in given.items():
        (files / name).write_bytes(content)
    for root in (by_hand, service.folder / "new"):
        workspace_at(root)
    ids = {name: service.upload(name, content, "new") for name, content in given.items()}
    images = [name for name in ids if name.startswith("n") and name.endswith(".fit")]

    def submit(kind: JobKind, **parameters: object) -> Job:
        return service.submit_to("new", kind, **parameters)

    brought = submit(
        JobKind.IMAGES, uploads=[ids[name] for name in images], poses=ids["poses.csv"],
        camera=ids["nac.toml"], dark=ids["dark.fit"], letter="N", low=20, columns={},
    )  # fmt: skip
    made = submit(JobKind.KERNELS, out="kernels")
    exported = submit(JobKind.SOLUTION_EXPORT, name="imported", folder="spc")
    converted = submit(JobKind.CAMERA_CONVERT, uploads=[ids["nac.toml"]], out="cam.toml", name="B")
    service.work()
    printed = called(
        "images", by_hand, *(files / name for name in images), "--poses", files / "poses.csv",
        "--camera", files / "nac.toml", "--dark", files / "dark.fit", "--letter", "N",
        "--low", "20",
    )  # fmt: skip
    done = finished(service, brought)
    assert [one["name"] for one in done["new"]] == [one["name"] for one in printed["new"]]
    # The catalogue names files where they remain, not where the job read them.
    uploads = service.folder / ".service" / "uploads"
    catalogue = read_catalogue(Workspace.open(service.folder / "new"))
    kept = {name: str(uploads / one / "file" / name) for name, one in ids.items()}
    for record in catalogue.values():
        assert record.source == kept[record.original]
        assert Path(record.source).is_file()
        assert record.state is not None
        assert (record.state["from"], record.camera) == (kept["poses.csv"], kept["nac.toml"])
    outputs = service.folder / ".service" / "outputs" / "new"
    called("kernels", by_hand, tmp_path / "kernels")
    called("solution", "export", by_hand, "imported", tmp_path / "spc")
    called("camera", "convert", files / "nac.toml", "--name", "B", "-o", tmp_path / "cam.toml")
    for name in ("IMAGEFILES", "SUMFILES"):
        found, wanted = (
            {path.name: path.read_bytes() for path in (root / name).iterdir()}
            for root in (service.folder / "new", by_hand)
        )
        assert found == wanted
        assert found
    assert finished(service, made)["folder"] == "outputs/kernels"
    assert files_in(outputs / "spc") == files_in(tmp_path / "spc")
    assert sorted(finished(service, exported)["written"]) > []
    assert finished(service, converted)["out"] == "outputs/cam.toml"
    assert (outputs / "cam.toml").read_bytes() == (tmp_path / "cam.toml").read_bytes()
    assert files_in(outputs / "kernels").keys() == files_in(tmp_path / "kernels").keys()
    assert not [*(service.folder / ".service" / "gathered").iterdir()]


def test_states_by_a_table_and_an_output_of_an_earlier_job(
    service: Service, given: dict[str, bytes], tmp_path: Path
) -> None:
    for name, content in given.items():
        (tmp_path / name).write_bytes(content)
    by_hand = workspace_at(tmp_path / "new")
    workspace_at(service.folder / "new")
    camera, poses = (service.upload(one, given[one], "new") for one in ("nac.toml", "poses.csv"))
    first = service.submit_to("new", JobKind.CAMERA_CONVERT, uploads=[camera], out="cam.toml")
    second = service.submit_to(
        "new", JobKind.SUMFILES, poses=poses, camera={"output": "cam.toml"}, sigma_m=2.0, letter="N"
    )
    missing = service.submit_to(
        "new", JobKind.SUMFILES, poses=poses, camera={"output": "none.toml"}
    )
    service.work()
    finished(service, first)
    called(
        "sumfiles", by_hand, "--poses", tmp_path / "poses.csv", "--camera", tmp_path / "nac.toml",
        "--sigma-m", 2.0, "--letter", "N",
    )  # fmt: skip
    assert len(finished(service, second)["images"]) == 3
    assert files_in(service.folder / "new" / "SUMFILES") == files_in(by_hand / "SUMFILES")
    error = service.store.job(missing.id).error
    assert error is not None
    assert (error.code, error.text) == (
        "invalid-value",
        "output 'none.toml': is no output of an earlier job",
    )


def test_a_camera_from_stars(service: Service, tmp_path: Path) -> None:
    cruise = Cruise(tmp_path)
    files = {
        "camera": tmp_path / "nominal.toml", "catalogue": tmp_path / "sky.csv",
        "attitudes": cruise.attitudes(), "stars": cruise.positions(),
    }  # fmt: skip
    uploads = {key: service.upload(path.name, path.read_bytes()) for key, path in files.items()}
    job = service.submit(JobKind.CAMERA_CALIBRATE, **uploads, out="nac.toml")
    service.work()
    options = [
        part for key in ("catalogue", "attitudes", "stars") for part in (f"--{key}", files[key])
    ]
    printed = called("camera", "calibrate", files["camera"], *options, "-o", tmp_path / "nac.toml")
    done = finished(service, job)
    out = service.folder / ".service" / "outputs" / "ball" / "nac.toml"
    check_calibration(done, out)
    assert out.read_bytes() == (tmp_path / "nac.toml").read_bytes()
    assert done == printed | {"out": "outputs/nac.toml"}


def test_a_meta_kernel_leads_to_no_other_file(service: Service, tmp_path: Path) -> None:
    outside = tmp_path / "outside.tpc"
    outside.write_text("KPL/PCK\n\\begindata\nBODY2101955_POLE_RA = ( 85.0 0.0 0.0 )\n")
    text = f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( '{outside}' )\n"
    meta = service.upload("all.tm", text.encode())
    table = service.upload("images.csv", b"image,utc\nN1,2019-03-03T10:59:40\n")
    job = service.submit(
        JobKind.SUMFILES, table=table, kernel=[meta], frame="SC64_SPC_1", camera=table
    )
    service.work()
    error = service.store.job(job.id).error
    assert error is not None
    assert "names a file that is not an upload of the job" in error.text
    assert str(tmp_path) not in error.text


def test_solutions_are_used_and_removed(service: Service) -> None:
    jobs = [
        service.submit(JobKind.SOLUTION_USE, name="imported"),
        service.submit(JobKind.SOLUTION_USE, name="none"),
        service.submit(JobKind.SOLUTION_REMOVE, name="imported"),
        service.submit(JobKind.SOLUTION_REMOVE, name=""),
    ]
    service.work()
    assert finished(service, jobs[0]) == {"in_use": "imported"}
    errors = [service.store.job(job.id).error for job in jobs[1:]]
    assert [one and one.code for one in errors] == ["workspace", "workspace", "invalid-value"]


def test_a_solution_that_a_lost_worker_removed_is_removed(service: Service) -> None:
    workspace = Workspace.open(service.workspace)
    with making_solution(workspace, "scaled", MadeBy("a test", {}, {}, {})):
        pass
    jobs = {}
    # Both were begun by a worker that was lost; it had removed the one, and not recorded that.
    for name in ("scaled", "never"):
        jobs[name] = service.submit(JobKind.SOLUTION_REMOVE, name=name)
        claimed = service.store.claim("lost", 60.0)
        assert claimed is not None
        assert claimed.id == jobs[name].id
        if name == "scaled":
            remove_solution(workspace, name, job=claimed.id)
        service.store.give_back(claimed.id, "lost")
        service.work()
    assert finished(service, jobs["scaled"]) == {"removed": "scaled"}
    error = service.store.job(jobs["never"].id).error
    assert error is not None
    assert "there is no solution 'never'" in error.text


def test_a_run_on_a_real_scheduler_and_a_reproduced_one_are_that_of_the_command(
    service: Service, by_command: tuple[Path, dict]
) -> None:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        job = service.submit(stages=["mapolas"])
        service.work(cluster=cluster.scheduler_address)
    finished(service, job)
    wanted = files_in(by_command[0])
    assert files_in(service.workspace) == wanted
    request = run_request(Workspace.open(by_command[0]), "imported:mapolas")
    shutil.rmtree(service.workspace / ".items")
    again = service.submit(JobKind(request["kind"]), **request["parameters"])
    service.work()
    finished(service, again)
    assert files_in(service.workspace) == wanted
    one, two = (
        run_record(Workspace.open(root), "imported:mapolas")
        for root in (by_command[0], service.workspace)
    )
    compared = runs_compared(one, two)
    assert compared["same"]
    assert not any(compared[key] for key in ("settings", "results", "inputs", "outputs"))

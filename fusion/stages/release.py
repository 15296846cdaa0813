"""Release: fused maplets and bigmaps as products, with a manifest of their provenance."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fusion.fusing.maplets import (
    FUSED_HDF5,
    FusedMaplet,
    fused_bigmap,
    fused_names,
    read_fused,
    write_fused,
)
from fusion.pipeline import Stage, StageContext, StageResult
from fusion.pipeline.catalog import FileDigests, read_records
from fusion.products import (
    MANIFEST_FILE,
    Product,
    Provenance,
    describe_product,
    manifest_text,
    product_stems,
    write_manifest,
)
from fusion.products.formats import write_fits_dtm, write_geotiff, write_obj, write_ply
from fusion.runtime.folders import make_folder
from fusion.runtime.remaining import note_found
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings
from fusion.workspace.settings.processing import ReleaseSettings
from spcola import atomic
from spcola.atomic import write_error
from spcola.formats.maplets import read_maplet
from spcola.grids import MapletGrid

Writer = Callable[[Path, FusedMaplet, Provenance], None]

SURFACE_WRITERS: Mapping[str, tuple[str, Writer]] = {
    "geotiff": (".tif", write_geotiff),
    "obj": (".obj", write_obj),
    "ply": (".ply", write_ply),
}
"""Format → suffix and writer, for formats that need only the maplet."""


UPSTREAM = ("ingest", "mapolas", "register", "fuse", "bigmap")
"""Stages whose settings the products depend on."""


@dataclass(frozen=True)
class Origins:
    """Provenance of products.

    Parameters
    ----------
    workspace : Workspace
    body : str
    stages : tuple of mappings
        Records of the stages upstream; without times, so that equal runs give equal files.
    settings : mapping
        Their settings and those of the release.
    digest : callable
        SHA-256 of a file; each file is read once.
    """

    workspace: Workspace
    body: str
    stages: tuple[Mapping[str, Any], ...]
    settings: Mapping[str, Any]
    digest: Callable[[Path], str]

    @classmethod
    def of(cls, context: StageContext) -> Origins:
        """Read the records of the stages before this one."""
        records = [asdict(r) for r in read_records(context.workspace) if r.stage in UPSTREAM]
        stages = [{k: v for k, v in record.items() if k != "finished"} for record in records]
        settings: dict[str, Any] = {}
        for record in records:
            settings |= record["settings"]
        for kind in context.tables:
            settings[kind.__name__] = context.table(kind).model_dump(mode="json")
        body = context.table(BodySettings).name
        return cls(context.workspace, body, tuple(stages), settings, FileDigests())

    def made_from(self, name: str) -> dict[str, str]:
        """Return path → digest of the files of which the maplet `name` (empty: all) was made."""
        root = self.workspace.home
        candidates = [root / "fused" / FUSED_HDF5, self.workspace.registration_path]
        if name:
            candidates += [self.workspace.maplet_path(name), root / "mapolas" / f"{name}.MAP"]
            candidates += [root / "bigmaps" / f"{name}.MAP"]
        return self.digests([path for path in candidates if path.is_file()])

    def digests(self, paths: list[Path]) -> dict[str, str]:
        """Return path in the workspace → digest."""
        return {self.workspace.relative(path): self.digest(path) for path in paths}

    def provenance(self, made_from: Mapping[str, str]) -> Provenance:
        """Return the provenance to write into a product."""
        return Provenance(self.body, made_from, self.settings)


class ReleaseStage(Stage):
    """Fused maplets and bigmaps → release/ with its manifest."""

    name = "release"
    version = 1
    needs = ("fuse", "bigmap")
    places = ("release",)
    tables = (ReleaseSettings, BodySettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why nothing can be released; empty if it can."""
        if not (workspace.home / "fused" / FUSED_HDF5).is_file():
            return f"there are no fused maplets; run: spcola fuse {workspace.root}"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return fused maplets and bigmaps."""
        fused = [workspace.fused_path(name) for name in workspace.fused_names()]
        return [workspace.home / "fused" / FUSED_HDF5, *fused, *bigmap_paths(workspace)]

    def run(self, context: StageContext) -> StageResult:
        """Build everything in the scratch folder, then move it to release/, the manifest last.

        A manifest always describes the products next to it: the old one is removed before the
        first product is replaced.
        """
        build = context.scratch / "products"
        make_folder(build)
        origins = Origins.of(context)
        made = build_products(context, build, origins)
        products = [*made, *_kept_products(context, {product.file for product in made})]
        inputs = self.inputs(context.workspace, context.settings)
        provenance = origins.provenance(origins.digests(inputs))
        text = manifest_text(products, provenance, origins.stages)
        folder = context.workspace.home / "release"
        paths = publish(build, folder, [product.file for product in made], text)
        kinds = sorted({product.kind for product in products})
        summary = {
            "maplets": len({product.maplet for product in products if product.maplet}),
            "products": len(products),
            **{kind: sum(product.kind == kind for product in products) for kind in kinds},
            "megabytes": sum(product.bytes for product in products) / 1e6,
        }
        return StageResult(tuple(paths), summary)


STAGE = ReleaseStage()


def bigmap_paths(workspace: Workspace) -> list[Path]:
    """Return the bigmaps of the workspace, with their sigma companions and further layers."""
    folder = workspace.home / "bigmaps"
    return [path for path in sorted(folder.glob("[!.]*")) if path.is_file()]


def build_products(context: StageContext, build: Path, origins: Origins) -> list[Product]:
    """Write every product into the folder `build`; return their entries."""
    workspace, table = context.workspace, context.table(ReleaseSettings)
    names = [*fused_names(workspace.home / "fused"), *_bigmap_names(workspace)]
    grids = [_grid(workspace, name) for name in names]
    stems = dict(zip(names, product_stems(grids, version=table.version), strict=True))

    def one(name: str) -> list[Product]:
        done = build / f".{stems[name]}.json"
        if finished := _finished(done):
            note_found()
            return finished
        made_from = origins.made_from(name)
        maplet, provenance = load_fused(workspace, name), origins.provenance(made_from)
        products = [
            describe_product(path, kind=kind, maplet=name, made_from=made_from)
            for kind, path in _write(build / stems[name], maplet, provenance, table)
        ]
        atomic.write_text(done, json.dumps([asdict(product) for product in products]))
        return products

    centers = {name: grid.center for name, grid in zip(names, grids, strict=True)}
    chosen = context.chosen(dict.fromkeys(names), centers)
    products = [product for made in context.map("release", one, chosen) for product in made]
    if "map" in table.products:
        products += _write_maps(workspace, build, names, origins)
    return products


def _finished(done: Path) -> list[Product]:
    """Return the products of a maplet that an interrupted release had written; else nothing.

    Their list is written when all are there. Some may have been moved to their place since.
    """
    if not done.is_file():
        return []
    listed = [Product(**entry) for entry in json.loads(done.read_text(encoding="utf-8"))]
    return listed if all((done.parent / one.file).is_file() for one in listed) else []


def _kept_products(context: StageContext, made: Collection[str]) -> list[Product]:
    """Return the products of an earlier release that are kept as they are; none but of a subset."""
    path = context.workspace.home / "release" / MANIFEST_FILE
    if not context.subset or not path.is_file():
        return []
    before = context.workspace.read_json(f"release/{MANIFEST_FILE}")["products"]
    products = [Product(**entry) for entry in before]
    return [product for product in products if product.file not in made]


def _write_maps(
    workspace: Workspace, build: Path, names: list[str], origins: Origins
) -> list[Product]:
    """Write the .MAP files, their sigmas and the HDF5 with the other layers."""
    maplets = (load_fused(workspace, name) for name in names)
    write_fused(build, maplets, sigma_companions=True)
    files = [("layers", FUSED_HDF5, "")]
    for name in names:
        files += [("map", f"{name}.MAP", name), ("sigma", f"{name}.SIG", name)]
    return [
        describe_product(build / file, kind=kind, maplet=name, made_from=origins.made_from(name))
        for kind, file, name in files
    ]


def load_fused(workspace: Workspace, name: str) -> FusedMaplet:
    """Read a fused maplet, or a bigmap with the sources of its fused maplets."""
    folder = workspace.home / "fused"
    if workspace.fused_path(name).is_file():
        return read_fused(folder, name)
    around = (read_fused(folder, other) for other in fused_names(folder))
    return fused_bigmap(read_maplet(workspace.home / "bigmaps" / f"{name}.MAP"), around)


def _grid(workspace: Workspace, name: str) -> MapletGrid:
    """Return the grid of a fused maplet or bigmap."""
    if workspace.fused_path(name).is_file():
        return read_fused(workspace.home / "fused", name).grid
    return read_maplet(workspace.home / "bigmaps" / f"{name}.MAP").grid


def publish(build: Path, folder: Path, files: list[str], manifest: str) -> list[Path]:
    """Move `files` from `build` to `folder`, then write the manifest; return all paths.

    Raises
    ------
    WorkspaceError
        If the folder cannot be written.
    """
    make_folder(folder)
    try:
        (folder / MANIFEST_FILE).unlink(missing_ok=True)
        for file in files:
            (build / file).replace(folder / file)
    except OSError as error:
        raise write_error(folder, error) from error
    return [*(folder / file for file in files), write_manifest(folder, manifest)]


def _write(
    stem: Path, maplet: FusedMaplet, provenance: Provenance, table: ReleaseSettings
) -> Iterator[tuple[str, Path]]:
    """Write the chosen formats, each as one file; yield kind and path."""
    if "fits" in table.products:
        path = stem.with_name(f"{stem.name}.fits")
        write_fits_dtm(path, maplet, provenance, version=table.version)
        yield "fits", path
    for kind, (suffix, write) in SURFACE_WRITERS.items():
        # A maplet without any height has no surface.
        if kind in table.products and (kind == "geotiff" or maplet.valid.any()):
            path = stem.with_name(f"{stem.name}{suffix}")
            write(path, maplet, provenance)
            yield kind, path


def _bigmap_names(workspace: Workspace) -> list[str]:
    """Return the names of bigmaps without those of fused maplets."""
    fused = set(workspace.fused_names())
    names = [path.stem for path in bigmap_paths(workspace) if path.suffix == ".MAP"]
    return [name for name in names if name not in fused]

"""Release: fused or solved maplets and bigmaps as products, with a manifest of provenance."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fusion.fusing.maplets import FUSED_HDF5, FusedMaplet, write_fused
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
from fusion.stages.made_maplets import MadeMaplets
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings
from fusion.workspace.settings.processing import ReleaseSettings
from spcola import atomic
from spcola.atomic import write_error
from spcola.formats.maplets import read_maplet
from spcola.grids import Maplet

Writer = Callable[[Path, Maplet, Provenance], None]

SURFACE_WRITERS: Mapping[str, tuple[str, Writer]] = {
    "geotiff": (".tif", write_geotiff),
    "obj": (".obj", write_obj),
    "ply": (".ply", write_ply),
}
"""Format → suffix and writer, for formats that need only the maplet."""


UPSTREAM = ("ingest", "mapolas", "register", "fuse", "bigmap")
"""Stages whose settings the products depend on."""

_COMPANIONS = {
    "map": ".MAP",
    "sigma": ".SIG",
    "albedo_sigma": ".ASG",
    "slope_sigma": ".SSG",
    "slope_directions": ".SDR",
}


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
    maplets : MadeMaplets
        Those that are released.
    """

    workspace: Workspace
    body: str
    stages: tuple[Mapping[str, Any], ...]
    settings: Mapping[str, Any]
    digest: Callable[[Path], str]
    maplets: MadeMaplets

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
        maplets = MadeMaplets.of(context.workspace)
        return cls(context.workspace, body, tuple(stages), settings, FileDigests(), maplets)

    def made_from(self, name: str) -> dict[str, str]:
        """Return path → digest of the files of which the maplet `name` (empty: all) was made."""
        root = self.workspace.home
        candidates = [self.workspace.photoclinometry_path]
        if self.maplets.kind == "fused":
            candidates = [root / "fused" / FUSED_HDF5, self.workspace.registration_path]
        if name:
            candidates += [self.workspace.maplet_path(name)]
            if self.maplets.kind == "fused":
                candidates += [root / "mapolas" / f"{name}.MAP"]
            candidates += [root / "bigmaps" / f"{name}.MAP"]
        return self.digests([path for path in candidates if path.is_file()])

    def digests(self, paths: list[Path]) -> dict[str, str]:
        """Return path in the workspace → digest."""
        return {self.workspace.relative(path): self.digest(path) for path in paths}

    def provenance(self, made_from: Mapping[str, str]) -> Provenance:
        """Return the provenance to write into a product."""
        return Provenance(self.body, made_from, self.settings)


class ReleaseStage(Stage):
    """Fused or solved maplets and bigmaps → release/ with its manifest."""

    name = "release"
    version = 1
    needs = ("fuse", "bigmap")
    places = ("release",)
    tables = (ReleaseSettings, BodySettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why nothing can be released; empty if it can."""
        return MadeMaplets.of(workspace).missing

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return fused or solved maplets and bigmaps."""
        return [*MadeMaplets.of(workspace).paths, *bigmap_paths(workspace)]

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
    table, maplets = context.table(ReleaseSettings), origins.maplets
    names = [*maplets.names, *_bigmap_names(maplets)]
    grids = [load_made(maplets, name, plain=True).grid for name in names]
    source = maplets.source
    found = product_stems(grids, version=table.version, source=source)
    stems = dict(zip(names, found, strict=True))

    def one(name: str) -> list[Product]:
        done = build / f".{stems[name]}.json"
        if finished := _finished(done):
            note_found()
            return finished
        made_from = origins.made_from(name)
        maplet, provenance = load_made(maplets, name), origins.provenance(made_from)
        products = [
            describe_product(path, kind=kind, maplet=name, made_from=made_from)
            for kind, path in _write(build / stems[name], maplet, provenance, table, source)
        ]
        atomic.write_text(done, json.dumps([asdict(product) for product in products]))
        return products

    centers = {name: grid.center for name, grid in zip(names, grids, strict=True)}
    chosen = context.chosen(dict.fromkeys(names), centers)
    products = [product for made in context.map("release", one, chosen) for product in made]
    if "map" in table.products:
        write = _write_maps if maplets.kind == "fused" else _copy_maps
        products += write(build, names, origins)
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


def _write_maps(build: Path, names: list[str], origins: Origins) -> list[Product]:
    """Write the .MAP files, their sigmas and the HDF5 with the other layers."""
    maplets = (load_made(origins.maplets, name) for name in names)
    fused = (maplet for maplet in maplets if isinstance(maplet, FusedMaplet))
    write_fused(build, fused, sigma_companions=True)
    files = [("layers", FUSED_HDF5, "")]
    for name in names:
        files += [("map", f"{name}.MAP", name), ("sigma", f"{name}.SIG", name)]
    return [
        describe_product(build / file, kind=kind, maplet=name, made_from=origins.made_from(name))
        for kind, file, name in files
    ]


def _copy_maps(build: Path, names: list[str], origins: Origins) -> list[Product]:
    """Copy the .MAP files of solved maplets and their bigmaps, with the sigmas that they have."""
    products = []
    for name in names:
        for kind, suffix in _COMPANIONS.items():
            path = _file_of(origins.maplets, name).with_suffix(suffix)
            if path.is_file():
                copied, made_from = build / path.name, origins.made_from(name)
                atomic.write_bytes(copied, path.read_bytes())
                products.append(
                    describe_product(copied, kind=kind, maplet=name, made_from=made_from)
                )
    return products


def _file_of(maplets: MadeMaplets, name: str) -> Path:
    """Return the .MAP of a maplet, or of a bigmap."""
    bigmap = maplets.workspace.home / "bigmaps" / f"{name}.MAP"
    return maplets.path(name) if name in maplets.names else bigmap


def load_made(maplets: MadeMaplets, name: str, *, plain: bool = False) -> Maplet:
    """Read a maplet, or a bigmap; of fused maplets with their sources unless `plain`."""
    if name in maplets.names:
        return maplets.read(name)
    path = _file_of(maplets, name)
    return read_maplet(path) if plain else maplets.bigmap(path)


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
    stem: Path, maplet: Maplet, provenance: Provenance, table: ReleaseSettings, source: str
) -> Iterator[tuple[str, Path]]:
    """Write the chosen formats, each as one file; yield kind and path."""
    if "fits" in table.products:
        path = stem.with_name(f"{stem.name}.fits")
        write_fits_dtm(path, maplet, provenance, source=source, version=table.version)
        yield "fits", path
    for kind, (suffix, write) in SURFACE_WRITERS.items():
        # A maplet without any height has no surface.
        if kind in table.products and (kind == "geotiff" or maplet.valid.any()):
            path = stem.with_name(f"{stem.name}{suffix}")
            write(path, maplet, provenance)
            yield kind, path


def _bigmap_names(maplets: MadeMaplets) -> list[str]:
    """Return the names of bigmaps without those of maplets."""
    names = [path.stem for path in bigmap_paths(maplets.workspace) if path.suffix == ".MAP"]
    return [name for name in names if name not in maplets.names]

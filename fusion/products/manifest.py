"""Provenance of products, and the manifest of a release."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import spcola
from spcola import atomic
from spcola.errors import WorkspaceError

MANIFEST_FILE = "manifest.json"
FORMAT = "spcola release 1"


def versions() -> dict[str, str]:
    """Return the versions of spcola, numpy, scipy and Python."""
    return {
        "spcola": spcola.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }


@dataclass(frozen=True)
class Provenance:
    """What one product was made from; also written into the product.

    Parameters
    ----------
    body : str
        Name of the body and its body-fixed frame.
    made_from : mapping of str to str
        Path in the workspace → SHA-256.
    settings : mapping
        Tables of settings that the product depends on, JSON types.
    versions : mapping of str to str
        Versions of the program and its numerical libraries.
    """

    body: str
    made_from: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=versions)

    @property
    def settings_digest(self) -> str:
        """SHA-256 of the settings; the order of keys does not matter."""
        return hashlib.sha256(_line(self.settings).encode()).hexdigest()

    def text(self) -> str:
        """Return one line of ASCII JSON, the same for the same content."""
        return _line({**asdict(self), "settings_digest": self.settings_digest})


@dataclass(frozen=True)
class Product:
    """One file of a release.

    Parameters
    ----------
    file : str
        Name in the release folder.
    kind : str
        ``map``, ``sigma``, ``fits``, ``geotiff``, ``obj``, ``ply``, ``layers``; of maplets solved
        from images also ``albedo_sigma`` (.ASG), ``slope_sigma`` (.SSG) and ``slope_directions``
        (.SDR), and no layers.
    maplet : str
        Name of the maplet or bigmap; empty for a file of all of them.
    sha256 : str
    bytes : int
    made_from : mapping of str to str
        Path in the workspace → SHA-256.
    """

    file: str
    kind: str
    maplet: str
    sha256: str
    bytes: int
    made_from: Mapping[str, str]


def describe_product(
    path: Path, *, kind: str, maplet: str, made_from: Mapping[str, str]
) -> Product:
    """Return the entry of a finished product, with its size and digest.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        What it is.
    maplet : str
        Name of the maplet in it.
    made_from : mapping of str to str
        Path in the workspace → SHA-256.
    """
    try:
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        return Product(path.name, kind, maplet, digest, path.stat().st_size, dict(made_from))
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error


def manifest_text(
    products: Sequence[Product], provenance: Provenance, stages: Sequence[Mapping[str, Any]] = ()
) -> str:
    """Return the manifest of a release as JSON, without times, so that equal runs give equal files.

    Parameters
    ----------
    products : sequence of Product
    provenance : Provenance
        Of the release as a whole.
    stages : sequence of mappings
        How each stage before this one ran: name, key, settings, inputs with digests.
    """
    content = {
        "format": FORMAT,
        "body": provenance.body,
        "versions": dict(provenance.versions),
        "settings": dict(provenance.settings),
        "settings_digest": provenance.settings_digest,
        "made_from": dict(provenance.made_from),
        "products": [asdict(product) for product in sorted(products, key=lambda p: p.file)],
        "stages": list(stages),
    }
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"


def write_manifest(folder: Path, text: str) -> Path:
    """Write the manifest of the release in `folder`, whole or not at all.

    Parameters
    ----------
    folder : Path
    text : str
    """
    atomic.write_text(folder / MANIFEST_FILE, text)
    return folder / MANIFEST_FILE


def _line(content: Mapping[str, Any]) -> str:
    """Return canonical JSON on one line."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

"""Products of a release, and the manifest."""

from fusion.products.manifest import (
    MANIFEST_FILE,
    Product,
    Provenance,
    describe_product,
    manifest_text,
    versions,
    write_manifest,
)
from fusion.products.naming import product_stems

__all__ = [
    "MANIFEST_FILE",
    "Product",
    "Provenance",
    "describe_product",
    "manifest_text",
    "product_stems",
    "versions",
    "write_manifest",
]

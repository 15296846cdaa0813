"""How Sphinx builds the site; `scripts/docs` runs it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext"), str(HERE)]

import spcola

# The tutorial's commands run here; figures and examples are made from what they leave.
TUTORIAL = Path(os.environ.get("SPCOLA_TUTORIAL", HERE.parent / "build" / "tutorial"))
os.environ["SPCOLA_TUTORIAL"] = str(TUTORIAL)

project = "SPCOLA"
author = "the authors of SPCOLA"
copyright = "the authors of SPCOLA"
version = release = spcola.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "tutorial",
    "pictures",
    "generated",
    "sourcelinks",
    "nothing_fetched",
]
exclude_patterns = ["gallery", "figures", "_ext", "README.md"]
root_doc = "index"
highlight_language = "text"
nitpicky = True
# What other projects document cannot be looked up without fetching it.
nitpick_ignore_regex = [(r"py:.*", r"(?!spcola|lidar|fusion)\w+\..*")]
smartquotes = False
suppress_warnings = ["config.cache"]  # functions in the gallery's settings

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
myst_url_schemes = ["http", "https"]

autodoc_typehints = "none"  # docstrings state types with shapes and units
autodoc_member_order = "bysource"
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
numpydoc_xref_param_type = False

html_theme = "furo"
html_title = f"SPCOLA {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {"top_of_page_buttons": []}

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "default_thumb_file": str(HERE / "_static" / "surfaces.png"),
    "matplotlib_animations": False,
}

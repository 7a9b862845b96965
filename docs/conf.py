"""Sphinx configuration. ``make docs`` builds docs/ into build/docs/html; warnings are errors."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "programs"))

import reference_pages
import start_pictures
from docstrings import add_attribute_types, escape_formulas

import ocisac_fast

project = "ocisac_fast"
author = "the ocisac_fast contributors"
release = version = ocisac_fast.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "formulas",
]
html_theme = "furo"
smartquotes = False  # two minus signs are an option, no dash
copybutton_selector = "div:not(.highlight-output):not(.highlight-text) > div.highlight > pre"
html_show_copyright = False
html_math_renderer = "mathtext"
html_title = "ocisac_fast"
html_static_path = ["static"]
html_css_files = ["style.css"]
exclude_patterns = ["generated/demo", "programs", "gallery/GALLERY_HEADER.rst"]
suppress_warnings = ["config.cache", "ref.python"]  # two classes may have an attribute of one name

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_type_aliases = {name: name.rpartition(".")[2] for name in ("npt.ArrayLike", "npt.DTypeLike", "Float64s")}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

# `make docs-links`: web pages change and fail; a nightly run reports them and does not fail.
linkcheck_timeout = 20
linkcheck_workers = 4
linkcheck_ignore = [r"http://localhost.*"]

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"__init__\.py",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "matplotlib_animations": False,
    "image_srcset": ["2x"],
    "reference_url": {},
    "remove_config_comments": True,
}


def setup(app):
    """Generated pages and pictures are written before Sphinx reads the sources."""
    app.connect("autodoc-process-docstring", add_attribute_types, priority=100)  # before napoleon
    app.connect("autodoc-process-docstring", escape_formulas, priority=101)
    for part in ("description", "options", "arguments"):
        app.connect(f"sphinx-click-process-{part}", escape_formulas)
    reference_pages.write(HERE / "generated")
    if os.environ.get("OCISAC_DOCS_PICTURES", "1") != "0":
        start_pictures.draw(HERE)

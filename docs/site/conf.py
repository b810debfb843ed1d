"""Sphinx' settings of the site; the source folder is the repository, and pages are read from their places there."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from myst_parser.parsers.sphinx_ import MystParser

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from docs.site import index, repository  # noqa: E402
from docs.site.notebooks import markdown_of  # noqa: E402
from mesh_motion_server import __version__  # noqa: E402

project = "mesh-motion server"
author = "the authors of mesh-motion server"
version = release = __version__
root_doc = index.INDEX
include_patterns = list(index.PAGES)
# folders that Sphinx need not walk through
exclude_patterns = [
    ".*",
    "out",
    "dist",
    "build",
    "tests",
    "mesh_motion_server",
    "numerics/mesh_motion_numerics",
    "docs/studies",
    "docs/site",
]

extensions = ["myst_parser", "sphinx_copybutton"]
nitpicky = True
smartquotes = False  # quotes are often part of the text
myst_heading_anchors = 6
myst_links_external_new_tab = False
# a block without a language is text; code hosts show unknown languages as text too
highlight_language = "text"
# SPEC.md's messages are headings of the fourth level below one of the second
suppress_warnings = ["misc.highlighting_failure", "myst.header"]

html_theme = "furo"
html_title = "mesh-motion server"
html_static_path = [str(ROOT / "docs" / "site" / "static")]
html_css_files = ["site.css"]
html_extra_path = [str(ROOT / "docs" / "site" / "root")]
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": False, "top_of_page_buttons": []}
copybutton_selector = "div.highlight-sh pre, div.highlight-python pre, div.highlight-toml pre, div.highlight-c pre"

_TOCTREES = index.toctrees((ROOT / f"{index.INDEX}.md").read_text(encoding="utf-8"))


def _complete(app: Any, page: str, source: list[str]) -> None:
    """Add the navigation, which the page itself does not have."""
    del app
    source[0] += _TOCTREES.get(page, "")


class NotebookParser(MystParser):
    """Parser of files ``.ipynb``, which also reads the navigation added at their end."""

    supported = ("ipynb",)

    def parse(self, inputstring: str, document: Any) -> None:
        notebook, end = json.JSONDecoder().raw_decode(inputstring)
        super().parse(markdown_of(notebook) + inputstring[end:], document)


def setup(app: Any) -> dict[str, bool]:
    app.add_source_suffix(".ipynb", "ipynb")
    app.add_source_parser(NotebookParser)
    app.connect("source-read", _complete)
    app.connect("doctree-read", repository.link_files, priority=100)
    app.connect("html-collect-pages", repository.pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Sphinx' settings of the site; the source folder is the repository, pages are in place."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from docs.site import index, reference, repository  # noqa: E402
from mesh_motion_server import __version__  # noqa: E402

project = "mesh-motion server"
author = "the authors of mesh-motion server"
version = release = __version__
root_doc = index.INDEX
include_patterns = list(index.PAGES)
# folders that Sphinx need not walk through
exclude_patterns = [".*", "out", "dist", "build", "tests", "mesh_motion_server", "proofs", "docs/studies", "docs/site"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
nitpicky = True
smartquotes = False  # quotes are often part of what is said
myst_heading_anchors = 6
myst_links_external_new_tab = False
# a block without a language is text; code hosts show unknown languages as text too
highlight_language = "text"
# SPEC.md's messages are headings of the fourth level below one of the second
suppress_warnings = ["misc.highlighting_failure", "myst.header"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Frame": "Frame", "Path": "Path"}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
# types in numpydoc are words ("(n, d) array"), no names to link
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_google_docstring = False

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
    """Add what the page itself does not have: generated parts, navigation."""
    del app
    source[0] = reference.filled(source[0]) + _TOCTREES.get(page, "")


def _words(app: Any, env: Any, node: Any, content: Any) -> Any:
    """A type in a docstring that is words, or another package's name, is no link; our names have to exist."""
    del app, env
    ours = str(node.get("reftarget", "")).startswith(("mesh_motion_", "."))
    return content if node.get("refdomain") == "py" and not ours else None


def _signature(app: Any, what: str, name: str, *rest: Any) -> tuple[str, str] | None:
    """What is made by a call of another object is not shown as if one made it oneself."""
    del app, what, rest
    return ("", "") if name in ("mesh_motion_client.Server", "mesh_motion_client.Session") else None


def setup(app: Any) -> dict[str, bool]:
    app.connect("source-read", _complete)
    app.connect("doctree-read", repository.link_files, priority=100)
    app.connect("html-collect-pages", repository.pages)
    app.connect("missing-reference", _words)
    app.connect("autodoc-process-signature", _signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Links from a page to a file of the repository that is not a page: each such file gets a page with its text.

A link to a folder leads to the folder's README if that is a page, otherwise to a list of its files.
"""

from __future__ import annotations

import html
import posixpath
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_for_filename
from pygments.lexers.special import TextLexer
from pygments.util import ClassNotFound
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.osutil import relative_uri

__all__ = ["link_files", "page_of", "pages"]

#: The site's folder of these pages.
FOLDER = "files"
_KEY = "repository_files"
#: A longer file is shown up to here, in characters.
_LONGEST = 200_000


def link_files(app: Sphinx, doctree: nodes.document) -> None:
    """Replace links to files and folders, before Sphinx looks for files to copy."""
    root, here = Path(app.srcdir), app.env.docname
    links = [*doctree.findall(addnodes.download_reference), *doctree.findall(addnodes.pending_xref)]
    for link in links:
        if link.get("reftype") != "myst" or link.get("refdomain") is not None:
            continue
        place = posixpath.normpath(posixpath.join(posixpath.dirname(here), link["reftarget"].partition("#")[0]))
        target = root / place
        if place.startswith("..") or not target.exists() or link["reftarget"].startswith("#"):
            continue
        if target.is_dir() and (target / "README.md").exists():
            link.replace_self(_page_link(link, here, f"{place}/README"))
            continue
        app.env.metadata[here].setdefault(_KEY, []).append(place)
        uri = relative_uri(app.builder.get_target_uri(here), app.builder.get_target_uri(page_of(place)))
        link.replace_self(nodes.reference("", "", *link.children, internal=True, refuri=uri))


def _page_link(link: nodes.Element, here: str, page: str) -> addnodes.pending_xref:
    """A link to a page; Sphinx resolves it, and warns if the page is missing."""
    attributes = {"refdomain": "doc", "reftarget": page, "reftargetid": None, "refdoc": here}
    return addnodes.pending_xref("", *link.children, reftype="myst", refexplicit=True, **attributes)


def page_of(place: str) -> str:
    """The name of the page that shows a file or folder of the repository."""
    return f"{FOLDER}/{place}"


def pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """The pages of all files that were linked to, and of the files in linked folders."""
    root = Path(app.srcdir)
    wanted = {place for metadata in app.env.metadata.values() for place in metadata.get(_KEY, [])}
    within = {f"{folder}/{name}" for folder in wanted for name in _files(root / folder)}
    for place in sorted(wanted | within):
        target = root / place
        body = _listing(place, _files(target)) if target.is_dir() else _shown(target)
        title = html.escape(place)
        yield page_of(place), {"title": title, "body": f"<h1>{title}</h1>\n{body}"}, "page.html"


def _files(folder: Path) -> list[str]:
    """Names of a folder's text files; empty if the path is not a folder."""
    if not folder.is_dir():
        return []
    return sorted(path.name for path in folder.iterdir() if path.is_file() and _text(path) is not None)


def _listing(place: str, names: list[str]) -> str:
    """A folder as a list of links to its files."""
    base = posixpath.basename(place)
    items = "".join(f'<li><a href="{base}/{name}.html">{html.escape(name)}</a></li>' for name in names)
    return f"<ul>{items}</ul>"


def _shown(path: Path) -> str:
    """A file's text, highlighted."""
    text = _text(path)
    if text is None:
        return f"<p>A binary file of {path.stat().st_size} bytes.</p>"
    try:
        lexer = get_lexer_for_filename(path.name, stripnl=False)
    except ClassNotFound:
        lexer = TextLexer(stripnl=False)
    cut = f"<p>Of {len(text)} characters the first {_LONGEST}:</p>\n" if len(text) > _LONGEST else ""
    return cut + str(highlight(text[:_LONGEST], lexer, HtmlFormatter(nowrap=False, cssclass="highlight")))


def _text(path: Path) -> str | None:
    """A file's text; None for a binary file."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None

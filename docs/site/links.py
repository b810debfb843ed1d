"""Checks every link of a built site: internal ones lead to a file and a place in it, others have the form of a link.

Nothing is fetched. Files that a page loads (scripts, styles, pictures) must be part of the site.
"""

from __future__ import annotations

import posixpath
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

__all__ = ["faults"]

#: Attributes that make a browser load something.
_LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src"), ("source", "src")}
_EXTERNAL = re.compile(
    r"https?://[A-Za-z0-9.-]+\.[A-Za-z]{2,}(:\d+)?(/\S*)?$|https?://(127\.0\.0\.1|localhost)(:\d+)?(/\S*)?$"
)
_STYLE = re.compile(r"url\(\s*[\"']?((?:https?:)?//[^)\"']+)|@import\s+[\"']((?:https?:)?//[^\"']+)")


@dataclass
class _Page(HTMLParser):
    """Links of a page, files that it loads, and places (anchors) in it."""

    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)
    places: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.places.add(value)
            elif (tag, name) in _LOADED:
                self.loaded.append(value)
            elif tag == "a" and name == "href":
                self.links.append(value)


def faults(site: Path) -> list[str]:
    """One line for each dead link, and for each file that is loaded from another site."""
    read: dict[str, _Page] = {}
    for path in sorted(site.rglob("*.html")):
        page = _Page()
        page.feed(path.read_text(encoding="utf-8"))
        read[path.relative_to(site).as_posix()] = page
    found = [f"{name}: {fault}" for name, page in read.items() for fault in _faults_of(site, name, page, read)]
    return found + [
        f"{path.relative_to(site).as_posix()}: loads {next(filter(None, match.groups()))}"
        for path in sorted(site.rglob("*.css"))
        for match in _STYLE.finditer(path.read_text(encoding="utf-8"))
    ]


def _faults_of(site: Path, name: str, page: _Page, read: dict[str, _Page]) -> list[str]:
    """The faults of one page."""
    wrong = [f"loads {url}" for url in page.loaded if urlsplit(url).netloc or not _exists(site, name, url)]
    for url in page.links:
        parts = urlsplit(url)
        if parts.scheme == "mailto":
            continue
        if parts.scheme or parts.netloc:
            wrong += [] if _EXTERNAL.match(url) else [f"no address: {url}"]
        elif not _exists(site, name, url):
            wrong.append(f"leads nowhere: {url}")
        elif parts.fragment and not _has_place(name, url, read):
            wrong.append(f"no such place: {url}")
    return wrong


def _target(name: str, url: str) -> str:
    """The file in the site that a relative link names; an empty path is the page itself."""
    path = unquote(urlsplit(url).path)
    return posixpath.normpath(posixpath.join(posixpath.dirname(name), path)) if path else name


def _exists(site: Path, name: str, url: str) -> bool:
    """Return True if the target of a relative link exists, or the link contains its data."""
    return url.startswith("data:") or (site / _target(name, url)).is_file()


def _has_place(name: str, url: str, read: dict[str, _Page]) -> bool:
    """Return True if the page has the link's fragment; files other than pages have no places."""
    target = read.get(_target(name, url))
    fragment = unquote(urlsplit(url).fragment)
    return target is None or not fragment or fragment in target.places

"""Navigation from the lists of ``docs/index.md``: headings are sections, links their pages, nested links subpages.

A reader on a code host sees the lists; Sphinx gets hidden toctrees with the same entries.
"""

from __future__ import annotations

import posixpath
import re

__all__ = ["INDEX", "PAGES", "toctrees"]

#: The page with the lists.
INDEX = "docs/index"
#: The pages of the site, in place: patterns of paths in the repository.
PAGES = (
    "README.md",
    "CHANGELOG.md",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "docs/*.md",
    "docs/tutorials/*.md",
    "docs/tutorials/*.ipynb",
    "docs/howto/*.md",
    "docs/reference/*.md",
    "numerics/README.md",
    "numerics/kernels/README.md",
    "recipes/README.md",
    "adapters/README.md",
    "adapters/*/README.md",
    "protocol/SPEC.md",
    "protocol/conformance/README.md",
    "benchmarks/README.md",
    "changes/README.md",
    "examples/README.md",
    "examples/*/README.md",
)

_SECTION = re.compile(r"^## (?P<name>.+)$")
_ENTRY = re.compile(r"^(?P<indent> *)- \[(?P<title>[^\]]+)\]\((?P<target>[^)#:]+)\.(?:md|ipynb)\)")


def toctrees(text: str) -> dict[str, str]:
    """Page name → hidden toctrees to add at the page's end, from the text of the index."""
    trees: dict[str, dict[str, list[str]]] = {INDEX: {}}
    section = parent = ""
    for line in text.splitlines():
        if found := _SECTION.match(line):
            section = found["name"]
        elif found := _ENTRY.match(line):
            page = posixpath.normpath(posixpath.join(posixpath.dirname(INDEX), found["target"]))
            entry = f"{found['title']} </{page}>"
            if found["indent"]:
                trees.setdefault(parent, {}).setdefault("", []).append(entry)
            else:
                parent = page
                trees[INDEX].setdefault(section, []).append(entry)
    return {
        page: "".join(_toctree(caption, entries) for caption, entries in sections.items())
        for page, sections in trees.items()
    }


def _toctree(caption: str, entries: list[str]) -> str:
    """One hidden toctree in MyST's Markdown."""
    lines = ["", "", "```{toctree}", ":hidden:", ":maxdepth: 2"]
    lines += [f":caption: {caption}"] if caption else []
    return "\n".join([*lines, "", *entries, "```", ""])

"""Puts a study's results into its page, between ``<!-- study: NAME -->`` and ``<!-- end -->``.

The text outside the markers does not change. A page may show a study at one place only.
"""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import fill as fill_lines

from docs.studies.study import Outcome, Study, save_picture

__all__ = ["DOCS", "fill", "marked", "render"]

DOCS = Path(__file__).parents[1]
_BLOCK = re.compile(r"(<!-- study: (?P<name>\w+) -->\n)(?P<body>.*?)(<!-- end -->)", re.DOTALL)


def marked(page: str) -> list[str]:
    """Names of the studies that a page has markers for, in its order."""
    return [found["name"] for found in _BLOCK.finditer((DOCS / f"{page}.md").read_text(encoding="utf-8"))]


def render(name: str, study: Study, outcome: Outcome, pictures: Path) -> str:
    """The Markdown of a study; its pictures are drawn into the folder ``pictures``."""
    parts = [f"*{study.source}.* {study.title}"]
    if study.functions:
        names = (f"`{function}`" for function in study.functions)
        parts.append(f"Done by {', '.join(names)}.")
    if outcome.text:
        parts.append(outcome.text)
    parts += [table.markdown() for table in outcome.tables]
    for number, picture in enumerate(outcome.pictures, start=1):
        file = name if len(outcome.pictures) == 1 else f"{name}_{number}"
        save_picture(picture, pictures / f"{file}.png")
        parts.append(f"![{picture.caption or study.title}](studies/pictures/{file}.png)")
        if picture.caption:
            parts.append(f"*{picture.caption}*")
    return wrapped("\n\n".join(parts)) + "\n"


def wrapped(text: str) -> str:
    """The text with lines of at most 150 characters, apart from tables and pictures."""
    filled = (
        part if part[:1] in "|!" else fill_lines(part, 150, break_long_words=False, break_on_hyphens=False)
        for part in text.split("\n\n")
    )
    return "\n\n".join(filled)


def fill(page: str, name: str, text: str) -> None:
    """Replace a study's block of a page.

    Raises
    ------
    ValueError
        If the page has no marker for the study.
    """
    path = DOCS / f"{page}.md"
    before = path.read_text(encoding="utf-8")
    if name not in marked(page):
        raise ValueError(f"docs/{page}.md: expected a line '<!-- study: {name} -->' and then '<!-- end -->'")
    after = _BLOCK.sub(lambda m: m[1] + text + m[4] if m["name"] == name else m[0], before)
    path.write_text(after, encoding="utf-8")

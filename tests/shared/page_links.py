"""Links of Markdown pages, and the names of their headings."""

import re
from pathlib import Path


def dead_links(page: Path, text: str) -> list[str]:
    """Links in this page that lead to no file of the checkout, or to no heading in it."""
    links = re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)]*))?\)", re.sub(r"(?s)```.*?```", "", text))
    wrong = []
    for file, anchor in links:
        path = page.parent / file if file else page
        if not path.exists() or (anchor and path.suffix == ".md" and anchor not in anchors(path.read_text("utf-8"))):
            wrong.append(f"{file}#{anchor}" if anchor else file)
    return sorted(wrong)


def anchors(text: str) -> set[str]:
    """The headings, named as on GitHub and as on the documentation's site."""
    headings = [heading.lower() for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE)]
    here = {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in headings}
    return here | {re.sub(r"[^a-z0-9]+", "-", heading).strip("-") for heading in headings}

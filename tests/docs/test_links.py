"""Every link of a page to a file of the checkout, and to a heading in it, has its target."""

from pathlib import Path

import pytest
from page_links import dead_links

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (".github", "adapters", "benchmarks", "changes", "docs", "examples", "numerics", "protocol")
PAGES = [*ROOT.glob("*.md"), *(page for folder in FOLDERS for page in (ROOT / folder).rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    assert dead_links(page, page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("wrong", ["a.md", "README.md#nowhere", "#nowhere"])
def test_a_dead_link_is_found(wrong: str) -> None:
    assert dead_links(ROOT / "README.md", f"# Here\n[this](#here) [that](README.md) [x]({wrong})\n") != []

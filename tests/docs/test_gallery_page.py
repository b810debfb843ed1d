"""docs/gallery.md: its films are those of the script, and small enough to load with the page."""

import re
from pathlib import Path

from PIL import Image

from docs.studies.gallery import FILMS, changed_case

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_shows_every_film() -> None:
    shown = re.findall(r"\]\(images/(\w+)\.webp\)", (DOCS / "gallery.md").read_text(encoding="utf-8"))
    assert shown == list(FILMS)
    for name in shown:
        path = DOCS / "images" / f"{name}.webp"
        assert path.stat().st_size <= 1_000_000
        with Image.open(path) as film:
            assert film.n_frames >= 16


def test_every_panel_changes_words_that_its_case_has() -> None:
    for example, steps, _, panels in FILMS.values():
        for changes in panels.values():
            text = changed_case(example, changes, steps)
            assert all(new in text for new in changes.values())

"""docs/gallery.md: its films are those of the script, and small enough to load with the page."""

import re
from pathlib import Path

from PIL import Image

from docs.studies.gallery import FILMS

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_shows_every_film() -> None:
    shown = re.findall(r"\]\(images/(\w+)\.webp\)", (DOCS / "gallery.md").read_text(encoding="utf-8"))
    assert shown == list(FILMS)
    for name in shown:
        path = DOCS / "images" / f"{name}.webp"
        assert path.stat().st_size <= 1_000_000
        with Image.open(path) as film:
            assert film.n_frames >= 16

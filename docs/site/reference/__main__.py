"""Update the generated parts of every page."""

from __future__ import annotations

import sys
from pathlib import Path

from docs.site.index import PAGES
from docs.site.reference import filled

ROOT = Path(__file__).resolve().parents[3]

for path in sorted(page for pattern in PAGES for page in ROOT.glob(pattern)):
    text = path.read_text(encoding="utf-8")
    if (now := filled(text)) != text:
        path.write_text(now, encoding="utf-8")
        sys.stdout.write(f"{path.relative_to(ROOT)}\n")

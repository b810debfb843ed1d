"""``python -m docs.site OUT``: build the site into OUT without a warning (of a dead link or a missing picture, say)."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Text that makes a browser load something from another site, in pages and in styles.
_ELSEWHERE = re.compile(
    r"""<(?:script|img|link|iframe|source)\b[^>]*?\b(?:src|href)=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|url\(\s*["']?((?:https?:)?//[^)"']+)|@import\s+["']((?:https?:)?//[^"']+)"""
)


def loads_from_elsewhere(text: str) -> list[str]:
    """Return addresses on other sites from which a page or a style sheet loads something."""
    return [next(filter(None, match.groups())) for match in _ELSEWHERE.finditer(text)]


def main(out: str) -> int:
    """Return 1 for a warning or a page that loads something from another site."""
    doctrees = str(Path(out).with_name(f"{Path(out).name}-doctrees"))
    options = ["-b", "html", "-W", "--keep-going", "-n", "-q", "-c", str(Path(__file__).parent), "-d", doctrees]
    status = subprocess.run([sys.executable, "-m", "sphinx", *options, str(ROOT), out], check=False).returncode
    pages = [path for path in Path(out).rglob("*") if path.suffix in {".html", ".css"}]
    found = [f"{path} loads {url}\n" for path in pages for url in loads_from_elsewhere(path.read_text("utf-8"))]
    sys.stderr.write("".join(found))
    return 1 if status or found else 0


if __name__ == "__main__":
    sys.exit(main(*(sys.argv[1:] or ["out/docs"])))

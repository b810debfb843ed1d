"""``python -m docs.site OUT``: build the site into OUT, without a warning, and check every link of it."""

from __future__ import annotations

import sys
from pathlib import Path

from sphinx.cmd.build import main as build

from docs.site.links import faults

ROOT = Path(__file__).resolve().parents[2]


def main(out: str) -> int:
    """Return 1 for a warning or a dead link."""
    doctrees = str(Path(out).with_name(f"{Path(out).name}-doctrees"))
    options = ["-b", "html", "-W", "--keep-going", "-n", "-q", "-c", str(Path(__file__).parent), "-d", doctrees]
    status = build([*options, str(ROOT), out])
    dead = faults(Path(out))
    sys.stderr.write("".join(f"{fault}\n" for fault in dead))
    return 1 if status or dead else 0


if __name__ == "__main__":
    sys.exit(main(*(sys.argv[1:] or ["out/docs"])))

"""``python -m docs.studies [NAME …]``: run the named studies, or all, and write their results into the pages."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from docs.studies.catalogue import PAGES, names, study
from docs.studies.page import DOCS, fill, render


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the studies; return 2 for an unknown name."""
    known = {name: page for page in PAGES for name in names(page)}
    parser = argparse.ArgumentParser(prog="python -m docs.studies", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(known)}")
    parser.add_argument("--quick", action="store_true", help="fewer samples; checks only, the pages stay as they are")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.names if name not in known]:
        parser.error(f"unknown study {unknown[0]!r}; known are {', '.join(known)}")
    chosen = options.names or list(known)
    for number, name in enumerate(chosen, start=1):
        print(f"[{number}/{len(chosen)}] {name} … ", end="", flush=True)
        began = time.perf_counter()
        _run(known[name], name, options.quick)
        print(f"{time.perf_counter() - began:.1f} s", flush=True)
    return 0


def _run(page: str, name: str, quick: bool) -> None:
    """One study, its claims, and its block of the page."""
    found = study(page, name)
    outcome = found.run(quick)
    found.claims(outcome)
    if not quick:
        fill(page, name, render(name, found, outcome, DOCS / "studies" / "pictures"))


if __name__ == "__main__":
    raise SystemExit(main())

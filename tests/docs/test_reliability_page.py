"""docs/reliability.md names every row of the table of tests/faults, and only rows, tests and files that exist."""

import re
from pathlib import Path

from tests.faults.table import CHECKS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
PROMISES, _, REST = PAGE.partition("## What is not promised")


def test_each_row_has_its_promise() -> None:
    named = set(re.findall(r"^\|[^|]*\| ((?:`[a-z0-9-]+`(?:, )?)+) \|", PROMISES, re.MULTILINE))
    rows = [row for cell in named for row in re.findall(r"`([a-z0-9-]+)`", cell)]
    assert sorted(rows) == sorted(check.name for check in CHECKS)


def test_each_fault_has_what_found_it() -> None:
    found = re.findall(r"^\| ([a-z0-9, -]+) \| .+ \| .+ \|$", REST, re.MULTILINE)[1:]
    assert len(found) > 30
    known = {check.name for check in CHECKS} | {"journal", "operation"}
    assert {part for cell in found for part in cell.split(", ")} <= known

"""docs/distributed.md: its names exist."""

import re
from inspect import signature
from pathlib import Path

from mesh_motion_client import dask_ranks
from shown_commands import blocks

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "distributed.md").read_text(encoding="utf-8")


def test_calls_of_the_page_exist() -> None:
    shown = blocks(PAGE, "python")[1]
    assert set(re.findall(r"session\.(\w+)\(", shown)) == {"move", "commit", "write"}
    for name in re.findall(r"session\.(\w+)\(", shown):
        assert callable(getattr(dask_ranks.DaskSession, name))
    parameters = signature(dask_ranks.open_on_workers).parameters
    assert list(parameters)[:5] == ["endpoint", "cluster", "files", "roles", "settings"]
    assert {"credentials", "patience"} <= set(parameters)

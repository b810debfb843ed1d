"""docs/distributed.md: the settings that it shows are those that the ranks' tests take, its names exist."""

import ast
import re
from inspect import signature
from pathlib import Path

from mesh_motion_client import dask_ranks
from own_ranks import CORRECTED
from shown_commands import blocks

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "distributed.md").read_text(encoding="utf-8")


def test_the_settings_are_those_that_are_tested() -> None:
    first = ast.parse(blocks(PAGE, "python")[0]).body[0]
    assert isinstance(first, ast.Assign)
    settings = ast.literal_eval(first.value)
    assert settings.items() <= CORRECTED.items()


def test_what_the_page_calls_exists() -> None:
    shown = blocks(PAGE, "python")[1]
    assert set(re.findall(r"session\.(\w+)\(", shown)) == {"move", "commit", "write"}
    for name in re.findall(r"session\.(\w+)\(", shown):
        assert callable(getattr(dask_ranks.DaskSession, name))
    parameters = signature(dask_ranks.open_on_workers).parameters
    assert list(parameters)[:5] == ["endpoint", "cluster", "files", "roles", "settings"]
    assert {"credentials", "patience"} <= set(parameters)

"""docs/distributed.md: what it shows runs, what it names exists, and its tables are filled."""

import re
import tomllib
from pathlib import Path

import pytest
from shown_commands import blocks
from typer.testing import CliRunner

from mesh_motion_server.commands.app import app
from mesh_motion_server.settings import ServerSettings

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "distributed.md").read_text(encoding="utf-8")


def options(line: str) -> set[str]:
    return set(re.findall(r"(?<=\s)--[\w-]+", line))


def test_the_settings_are_some() -> None:
    settings = ServerSettings.from_mapping(tomllib.loads(blocks(PAGE, "toml")[0]))
    assert settings.distributed == "tls://10.0.0.1:8786"
    told = {name for name in ServerSettings.model_fields if name.startswith("distributed")}
    assert told == {line.split(" = ")[0] for line in blocks(PAGE, "toml")[0].splitlines()}


@pytest.mark.parametrize("command", ["serve", "play"])
def test_the_commands_have_these_options(command: str) -> None:
    (line,) = (line for line in blocks(PAGE, "bash")[0].splitlines() if line.startswith(f"mesh-motion {command}"))
    known = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"}).output
    assert all(option in known for option in options(line))


@pytest.mark.parametrize("command", ["scheduler", "worker"])
def test_dask_has_these_options(command: str) -> None:
    cli = pytest.importorskip("distributed.cli.dask_" + command)
    (line,) = (line for line in blocks(PAGE, "bash")[0].splitlines() if line.startswith(f"dask {command}"))
    known = {name for parameter in cli.main.params for name in (*parameter.opts, *parameter.secondary_opts)}
    assert options(line) <= known


def test_every_block_is_filled() -> None:
    filled = re.findall(r"<!-- benchmark: ([\w-]+) -->\n(.*?)<!-- end -->", PAGE, re.DOTALL)
    assert [name for name, _ in filled] == [
        "distributed-steps",
        "distributed-wire",
        "distributed-constants",
        "distributed-prediction",
    ]
    assert all(text.count("\n|") > 3 for _, text in filled)

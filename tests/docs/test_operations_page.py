"""Commands of docs/operations.md are run, and its facts are compared with the code."""

import json
import re
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from page_story import free_port
from shown_commands import blocks, run

from mesh_motion_server.commands.outcome import ExitStatus
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import telemetry

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "operations.md").read_text(encoding="utf-8")
TOOLS = ("curl", "flock")


@pytest.mark.slow
@pytest.mark.skipif(not all(map(shutil.which, TOOLS)), reason="needs curl and flock")
def test_the_first_block_runs(tmp_path: Path) -> None:
    (block,), (client,) = blocks(PAGE, "sh"), blocks(PAGE, "python")
    endpoint, metrics = (f"127.0.0.1:{free_port()}" for _ in range(2))
    script = block.replace("127.0.0.1:7440", endpoint).replace("127.0.0.1:9464", metrics)
    script = script.replace("python client.py", f"{sys.executable} client.py")
    script = "set -e\n" + script.replace("server.log &", "server.log & trap 'kill $! 2> /dev/null || true' EXIT", 1)
    done = run(script, tmp_path, client.replace("127.0.0.1:7440", endpoint))
    assert done.returncode == 0, done.stderr
    commits = re.search(r"^mesh_motion_commits_total (\S+)$", done.stdout, re.MULTILINE)
    assert float(commits[1]) == 3
    assert "in use" not in done.stdout
    stored = sorted(path.name for path in (tmp_path / "sessions" / "sessions").iterdir())
    assert len(stored) == 1
    assert sorted(path.name for path in (tmp_path / "backup" / "sessions").iterdir()) == stored


def test_the_settings_are_known_and_their_defaults_right(tmp_path: Path) -> None:
    settings, behind = (ServerSettings.from_mapping(tomllib.loads(block)) for block in blocks(PAGE, "toml"))
    assert behind.data_ports == "7441-7504"
    assert settings.metrics == "127.0.0.1:9464"
    rows = re.findall(r"^\| `([a-z_]+)` \| ([0-9.]+) \|", PAGE, re.MULTILINE)
    assert len(rows) > 8
    assert [(name, float(default)) for name, default in rows] == [
        (name, float(getattr(ServerSettings(), name))) for name, _ in rows
    ]


def test_figures_of_the_logs_are_those_of_the_code() -> None:
    (line,) = blocks(PAGE, "json")
    assert {"event", "level", "timestamp", "role", "session"} <= json.loads(line).keys()
    assert f"at most {telemetry._BURST:.0f} lines come at once and then one a second" in PAGE
    assert telemetry._RATE == 1
    assert f"cut at {telemetry._LONGEST} characters" in PAGE


def test_the_statuses_are_those_of_the_program() -> None:
    section = PAGE[PAGE.index("## Exit statuses") :]
    listed = {int(status) for status in re.findall(r"^\| (\d+) \|", section, re.MULTILINE)}
    assert listed == {ExitStatus.DONE, ExitStatus.UNAVAILABLE, ExitStatus.DEFECT, ExitStatus.CONFIGURATION}

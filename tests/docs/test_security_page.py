"""The commands and programs in docs/security.md are run."""

import sys
from pathlib import Path

import pytest
from page_story import free_port
from shown_commands import blocks, run

from mesh_motion_server.security.allow_list import read_entries

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    (found,) = blocks(PAGE, language)
    return found


@pytest.mark.nightly
def test_the_ten_lines_and_the_client_run(tmp_path: Path) -> None:
    endpoint = f"tcp://127.0.0.1:{free_port()}"
    lines = here(block("sh"), endpoint).splitlines()
    assert len(lines) <= 10
    *before, last = lines
    refused = f"! mesh-motion inspect --timeout 10 --endpoint {endpoint}"
    script = "\n".join(["set -e", *before, f"{sys.executable} client.py", last, refused, "kill $!", "wait $!"])
    script = script.replace("--state sessions &", "--state sessions & trap 'kill $!' EXIT")
    done = run(script, tmp_path, here(block("python"), endpoint))
    assert (tmp_path / "out" / "summary.json").exists(), done.stderr
    assert "mesh-motion-server" in done.stdout
    assert "alice is not admitted any more" in done.stdout
    assert "does not admit this key" in done.stderr


def here(text: str, endpoint: str) -> str:
    return text.replace("tcp://0.0.0.0:7440", endpoint).replace("tcp://workstation:7440", endpoint)


def test_the_allow_list_is_one(tmp_path: Path) -> None:
    path = tmp_path / "allow.toml"
    path.write_text(block("toml"))
    path.chmod(0o644)
    assert {entry.name: entry.roles for entry in read_entries(path).values()} == {
        "alice": ("owner",),
        "dashboard": ("monitor",),
    }

"""The Tab key in a real bash, and the completions for zsh and fish."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mesh_motion_server.commands.completions import log_levels, roles, session_folders
from mesh_motion_server.security.authorisation import ROLES

SESSION = "0123456789abcdef" * 2

#: The effect of Tab: bash calls the function that the script has registered, and shows what it offers.
_BASH = """
eval "$(_MESH_MOTION_COMPLETE=source_bash mesh-motion)"
read -r _ _ function _ <<< "$(complete -p mesh-motion | sed 's/.*-F/-o x/')"
for line in "$@"; do
    eval "COMP_WORDS=($line)"
    [ "${line: -1}" = " " ] && COMP_WORDS+=("")
    COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMP_LINE=$line COMP_POINT=${#line} COMPREPLY=()
    $function mesh-motion "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD-1]}"
    echo "${COMPREPLY[*]}"
done
"""


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """An environment with the command, and one stored session."""
    program = tmp_path / "bin" / "mesh-motion"
    program.parent.mkdir()
    program.write_text(f"#!{sys.executable}\nfrom mesh_motion_server.commands.cli import main\nmain()\n")
    program.chmod(0o755)
    (tmp_path / ".local" / "state" / "mesh-motion" / "sessions" / SESSION).mkdir(parents=True)
    return os.environ | {"HOME": str(tmp_path), "PATH": f"{program.parent}:{os.environ['PATH']}"}


def test_bash_completes_commands_options_and_values(home: dict[str, str]) -> None:
    lines = ["mesh-motion conf", "mesh-motion play --ev", "mesh-motion serve --log-level ",
             "mesh-motion inspect ", "mesh-motion play "]  # fmt: skip
    command = ["bash", "--norc", "-c", _BASH, "bash", *lines]
    run = subprocess.run(command, env=home, capture_output=True, text=True, timeout=60, check=False)
    state = f"{home['HOME']}/.local/state/mesh-motion"
    assert run.stderr == ""
    assert run.stdout.splitlines() == [
        "conform",
        "--every",
        "debug info warning error",
        f"{state} {state}/sessions/{SESSION}",
        "",  # bash offers files
    ]


@pytest.mark.parametrize(("shell", "word"), [("zsh", "compdef"), ("fish", "complete --command mesh-motion")])
def test_the_other_shells_have_their_script_and_answers(home: dict[str, str], shell: str, word: str) -> None:
    command = ["mesh-motion"]
    script = subprocess.run(
        command, env=home | {"_MESH_MOTION_COMPLETE": f"source_{shell}"}, capture_output=True, text=True, check=True
    )
    assert word in script.stdout
    asked = {"_MESH_MOTION_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": "mesh-motion conf"}
    asked |= {"_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    answer = subprocess.run(command, env=home | asked, capture_output=True, text=True, check=True)
    assert "conform" in answer.stdout


def test_the_words_are_those_that_are_taken() -> None:
    assert set(roles("")) == ROLES
    assert log_levels("w") == ["warning"]
    assert session_folders("/nowhere") == []

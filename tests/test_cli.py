"""The command line for people and programs: output, one-line errors, exit statuses."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from raising import raising

from mesh_motion_server import __version__
from mesh_motion_server.commands import app as commands
from mesh_motion_server.commands import outcome
from mesh_motion_server.commands.cli import main
from mesh_motion_server.commands.outcome import ExitStatus, status_of

EXAMPLES = Path(__file__).parents[1] / "examples"
ROTATION = EXAMPLES / "thesis_rotation" / "case.toml"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["mesh-motion", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        code = ended.value.code
        return int(code) if isinstance(code, int) else 0, captured.out, captured.err

    return run


def one_line(text: str) -> str:
    assert text.endswith("\n")
    assert text.count("\n") == 1, text
    assert "Traceback" not in text
    return text.strip()


def test_help_lists_the_commands_and_statuses(run: Run) -> None:
    status, out, _ = run("--help")
    assert status == 0
    for word in ("play", "check", "serve", "keys", "inspect", "conform", "demo", "version", "Exit status"):
        assert word in out


@pytest.mark.parametrize("command", ["play", "check", "serve", "inspect", "conform"])
def test_each_command_explains_itself_with_examples(run: Run, command: str) -> None:
    status, out, _ = run(command, "--help")
    assert status == 0
    assert f"mesh-motion {command} " in out


def test_conform_says_what_is_not_met(run: Run) -> None:
    status, out, _ = run("conform", "--client", shlex.join([sys.executable, "-c", ""]), "--only", "18.1", "-q")
    assert status == ExitStatus.UNMET
    assert "FAIL 18.1-" in out


@pytest.mark.parametrize(
    "arguments",
    [
        ["conform", "--endpoint", "tcp://127.0.0.1:9", "--json", "missing/report.json"],
        ["conform", "--endpoint", "tcp://127.0.0.1:9", "--junit", "missing/report.xml"],
        ["demo", "--out", "taken/demo"],
        ["plot", "none", "--out", "taken/history.png"],
    ],
)
def test_a_place_that_cannot_be_written_is_reported_before_the_work(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("a file")
    status, out, error = run(*arguments)
    assert (status, out, error.count("\n")) == (2, "", 1)
    assert "there is no folder" in error or "taken is not a folder" in error
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


@pytest.mark.parametrize("asked", ["version", "--version"])
def test_version(run: Run, asked: str) -> None:
    status, out, _ = run(asked)
    assert status == 0
    assert out.startswith(f"mesh-motion-server {__version__}, protocol 1.0\n")


@pytest.mark.parametrize(
    "arguments",
    [["fly"], ["play"], ["play", "a", "--out"], ["play", "a", "--out", "b", "--every", "0"],
     ["play", "--from-journal", "a"], ["inspect"],
     ["inspect", "a", "--endpoint", "b"], ["serve", "--log-level", "loud"], ["check", "a", "--xml"], ["conform"],
     ["conform", "--endpoint", "a", "--client", "b"]],
)  # fmt: skip
def test_wrong_usage_is_status_2(run: Run, arguments: list[str]) -> None:
    status, out, err = run(*arguments)
    assert status == ExitStatus.INVALID
    assert out == ""
    assert "Error" in err
    assert "Traceback" not in err


def test_keys_are_made_admitted_listed_and_revoked(run: Run, tmp_path: Path) -> None:
    server, client = str(tmp_path / "server"), str(tmp_path / "client")
    assert run("keys", "server", server)[0] == 0
    assert "admits no client" in run("keys", "list", server)[1]
    assert run("keys", "client", "alice", client)[0] == 0
    status, out, _ = run("keys", "allow", f"{client}/alice.public", server, "--role", "owner", "--role", "monitor")
    assert (status, out) == (0, "alice is admitted as owner, monitor\n")
    assert "owner,monitor" in run("keys", "list", server)[1]
    assert run("keys", "revoke", "alice", server)[0] == 0
    status, _, err = run("keys", "revoke", "alice", server)
    assert status == ExitStatus.INVALID
    assert one_line(err).endswith("it names no key")


def test_statuses_follow_the_error_codes() -> None:
    assert status_of("INVALID_ARGUMENT.NONFINITE") == 2
    assert status_of("FAILED_PRECONDITION.QUALITY") == 3
    assert status_of("FAILED_PRECONDITION.STEP") == 4
    assert status_of("RESOURCE_EXHAUSTED.DISK") == 4
    assert status_of("UNAVAILABLE.DRAINING") == 69
    assert status_of("INTERNAL") == 70


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('basis = "wendland-c2"', 'basis = "wendland-c9"', "wendland-c9"),
        ('outer = "fixed"', "", "patch 'outer' of mesh.npz has no role"),
        ('file = "mesh.npz"', 'file = "empty.npz"', "the mesh has no cells"),
    ],
)
def test_an_invalid_case_is_one_line_and_status_2(run: Run, tmp_path: Path, old: str, new: str, message: str) -> None:
    text = ROTATION.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "case.toml").write_text(text.replace(old, new), encoding="utf-8")
    (tmp_path / "mesh.npz").write_bytes((ROTATION.parent / "mesh.npz").read_bytes())
    np.savez(tmp_path / "empty.npz", points=np.zeros((1, 2)), cells_triangle=np.empty((0, 3), dtype=np.int64))
    status, out, err = run("check", tmp_path / "case.toml")
    assert status == ExitStatus.INVALID
    assert message in one_line(err)
    assert out == ""
    if "wendland" not in message:  # what only a server can know is tried where there is one
        status, _, err = run("play", tmp_path / "case.toml", "--out", tmp_path / "out")
        assert status == ExitStatus.INVALID
        assert message in one_line(err)
        assert not (tmp_path / "out").exists()


def test_check_prints_a_report_for_people_and_for_programs(run: Run) -> None:
    status, out, err = run("check", ROTATION)
    assert (status, err) == (0, "")
    out = " ".join(out.split())  # where lines break depends on the length of the path
    for part in ("723 nodes", "1342 triangle", "block: 12 nodes, moving", "0.5 in the case", "usable as a case"):
        assert part in out
    status, out, _ = run("check", ROTATION, "--json")
    report = json.loads(out)
    assert report["patches"] == {"outer": {"role": "fixed", "nodes": 92}, "block": {"role": "moving", "nodes": 12}}
    assert (report["warnings"], report["steps_accepted"], report["refused"]) == ([], 1, "")
    status, out, _ = run("check", ROTATION.parent / "mesh.npz")
    assert status == 0
    assert "usable as a mesh" in out


def test_check_says_what_will_be_refused(run: Run, tmp_path: Path) -> None:
    shutil.copy(ROTATION.parent / "mesh.npz", tmp_path)
    (tmp_path / "case.toml").write_text(ROTATION.read_text().replace("-0.2, -0.2", "-0.5, -0.2"))
    status, out, err = run("check", tmp_path / "case.toml")
    assert (status, "usable" in out) == (ExitStatus.REFUSED, False)
    leaves, refused = err.splitlines()
    assert leaves.startswith("mesh-motion: warning: the body leaves the domain in step 1: node ")
    assert refused.startswith(
        "mesh-motion: step 1 of 1 will be refused: no valid mesh exists: the boundary would cross"
    )
    assert run("check", tmp_path / "case.toml", "--seconds", "0")[0] == 0


def test_play_over_the_wire_and_its_exit_statuses(run: Run, tmp_path: Path) -> None:
    """Each case starts a private server: played, refused, and no server at an endpoint."""
    shutil.copytree(ROTATION.parent, tmp_path / "turned", ignore=shutil.ignore_patterns("out"))
    status, out, _ = run("play", tmp_path / "turned" / "case.toml")
    assert status == 0
    folder = tmp_path / "turned" / "out" / "turned"
    assert f"0 inverted cells: {folder}" in out
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["inverted_cells"] == 0
    assert summary["boundary_error"] <= 1e-12
    text = ROTATION.read_text(encoding="utf-8").replace("[-0.2, -0.2]", "[-0.9, -0.2]")
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    (tmp_path / "mesh.npz").write_bytes((ROTATION.parent / "mesh.npz").read_bytes())
    status, out, err = run("play", tmp_path / "case.toml", "--out", folder)
    assert status == ExitStatus.REFUSED
    one_line(err)
    assert out == ""
    names = {file.name for file in folder.iterdir()}  # the earlier results went
    assert names == {"mesh.pvd", "mesh_0000.vtu", "refused.vtu", "quality.png", "steps.csv", "summary.json"}


def test_wrong_and_unsafe_server_settings_are_status_78(run: Run, tmp_path: Path) -> None:
    status, _, err = run("serve", "--endpoint", "tcp://0.0.0.0:0")
    assert status == ExitStatus.CONFIGURATION
    assert "reached by other machines" in err
    (tmp_path / "server.toml").write_text("max_sessions = 0\n")
    status, _, err = run("serve", "--settings", tmp_path / "server.toml")
    assert status == ExitStatus.CONFIGURATION
    assert "max_sessions" in one_line(err)
    status, _, err = run("serve", "--settings", tmp_path / "none.toml")
    assert status == ExitStatus.CONFIGURATION
    one_line(err)


def test_without_the_server_extra_one_line_names_it(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("typer", "mesh_motion_server.commands.app"):
        monkeypatch.delitem(sys.modules, package, raising=False)
    monkeypatch.setitem(sys.modules, "typer", None)
    monkeypatch.setattr(sys, "argv", ["mesh-motion", "version"])
    status, _, err = run("version")
    assert status == ExitStatus.UNAVAILABLE
    assert "pip install 'mesh-motion-server[server]'" in one_line(err)


def test_a_defect_is_status_70_and_asks_to_be_reported(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "app", raising(ZeroDivisionError()))
    status, _, err = run("version")
    assert status == ExitStatus.DEFECT
    assert "please report" in err


def test_a_message_with_a_very_long_value_keeps_its_beginning_and_its_way_out(run: Run, tmp_path: Path) -> None:
    text = ROTATION.read_text().replace("[steps]", f'[steps]\ncount = "{"(" * 100_000}"')
    (tmp_path / "case.toml").write_text(re.sub(r"\ncount = \d+", "", text))
    status, _, error = run("check", tmp_path / "case.toml")
    line = one_line(error)
    assert status == ExitStatus.INVALID
    assert len(line) < 2000
    assert re.match(r"mesh-motion: .*case\.toml: .* … \(\d{5,} characters\) … ", line)


def test_the_table_of_statuses_is_the_enumeration() -> None:
    documented = {int(number) for number in re.findall(r"^(\d+) ", str(outcome.__doc__), re.MULTILINE)}
    assert documented == {int(status) for status in ExitStatus}


def test_a_reader_that_leaves_early_is_no_error() -> None:
    script = f"{sys.executable} -m mesh_motion_server check {ROTATION} --json | head -1; exit ${{PIPESTATUS[0]}}"
    ended = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, env=os.environ)
    assert ended.stderr == ""


@pytest.mark.parametrize("arguments", [["--help"], ["check", str(ROTATION)], ["version"]])
def test_output_on_a_full_disk_is_status_4(arguments: list[str]) -> None:
    """With `> report.txt`; it is written at once, or at the end of the process."""
    command = [sys.executable, "-m", "mesh_motion_server", *arguments]
    with open("/dev/full", "w", encoding="utf-8") as full:
        found = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (found.returncode, found.stderr.splitlines()[-1:]) == (
        ExitStatus.FAILED,
        ["mesh-motion: the output cannot be written: No space left on device"],
    )

"""``mesh-motion plot`` as a user calls it."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mesh_motion_server.commands.app import app

pytest.importorskip("matplotlib")

HEADER = "step,min_size,min_skew,min_size_skew,mean_size_skew,predicted_min,predicted_standard,enrichment_points,"
HEADER += "iterations,seconds,seconds_solve,seconds_predict,seconds_correct,seconds_displace\n"


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    rows = "".join(f"{n},0.9,0.8,0.{n},0.9,0.{n},0.{n},0,1,0.1,0.01,0.01,0.01,0.01\n" for n in range(1, 8))
    (folder / "steps.csv").write_text(HEADER + rows)
    return folder


def plot(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["plot", *map(str, arguments)])
    return result.exit_code, result.stderr


def test_a_picture_is_made_of_the_steps_asked_for(run_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "a.svg"
    assert plot(run_folder, "--out", out, "--steps", "2:4", "--size", "90x60", "--title", "Flag") == (0, "")
    texts = re.findall("<!-- (.*?) -->", out.read_text(encoding="utf-8"))  # of outlines
    assert {"Flag", "size-skew", "step", "minimum", "mean"} <= set(texts)
    assert {"2", "3", "4"} <= set(texts)
    assert "5" not in texts


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--steps", "4"], "--steps: expected A:B, A: or :B, got '4'"),
        (["--steps", "4:2"], "--steps: 2 comes before 4"),
        (["--metric", "volume"], "--metric: expected one of relative-size-skew, size-skew, "),
        (["--panel", "colour"], "enrichment, non-orthogonality, got 'colour'"),
        (["--size", "huge"], "--size: expected column"),
        (["--show", "mesh"], "mesh.pvd: not readable as the series that play writes"),
    ],
)
def test_wrong_arguments_are_one_line(run_folder: Path, tmp_path: Path, arguments: list[str], said: str) -> None:
    status, text = plot(run_folder, "--out", tmp_path / "a.png", *arguments)
    assert (status, said in text, text.count("\n")) == (2, True, 1)
    assert not (tmp_path / "a.png").exists()


def test_a_state_folder_is_answered_by_its_sessions(tmp_path: Path) -> None:
    session = tmp_path / "sessions" / ("ab" * 16)
    session.mkdir(parents=True)
    (session / "spec.json").write_text("{}")
    status, text = plot(tmp_path, "--out", tmp_path / "a.png")
    assert status == 2
    assert f"a server's state folder, expected a session's; it has {'ab' * 16}" in text


def test_neither_a_run_nor_a_folder(tmp_path: Path) -> None:
    assert "neither a session's folder nor one that play wrote" in plot(tmp_path, "--out", "a.png")[1]
    assert "no such folder" in plot(tmp_path / "gone", "--out", "a.png")[1]

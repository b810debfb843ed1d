"""The Mok benchmark: a short and coarse run in Kratos, and its verdict on seeded histories."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from mok_benchmark import execution
from mok_benchmark.__main__ import main
from mok_benchmark.benchmark import HEIGHT, LENGTH, OUTLET_FLOOR, WALL, WALL_HEIGHT
from mok_benchmark.execution import History
from mok_benchmark.meshes import channel_mesh, wall_lattice, write_fluid, write_solid
from mok_benchmark.verdict import differences, judged, table


@pytest.fixture(scope="module")
def channel():
    return channel_mesh(12, 0.12)


def moved(channel, amplitude=0.08, *, push=0.0):
    """An artificial history of four steps: the mesh stays, except for one interior node."""
    times = np.arange(1, 5) / 10.0
    displacements = np.zeros((4, 2, 2))
    displacements[:, 0, 0] = amplitude * np.sin(times)
    displacements[:, 1, 0] = 0.4 * amplitude * np.sin(times)
    points = np.repeat(channel.points[None], 4, axis=0)
    inner = np.setdiff1d(channel.triangles, np.concatenate(list(channel.edges.values())))[0]
    points[2, inner, 0] += push
    ones = np.ones(4)
    return History(
        times, displacements, displacements[:, 0], points, ones.astype(int), 0.1 * ones, ones, cpu_seconds=1.0
    )


def test_meshes_fit_each_other(channel, tmp_path):
    """The channel's area is the published geometry's, and its nodes on the wall are the wall's."""
    x, y = channel.points[channel.triangles].transpose(2, 1, 0)
    areas = 0.5 * ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
    assert areas.min() > 0.0
    below = 0.5 * OUTLET_FLOOR * (1.3 - WALL[1]) + OUTLET_FLOOR * (LENGTH - 1.3)
    whole = LENGTH * HEIGHT - WALL_HEIGHT * (WALL[1] - WALL[0]) - below
    assert areas.sum() == pytest.approx(whole, rel=0.01)  # the rounding is 0.4 %
    wall = write_solid(tmp_path / "solid.mdpa", wall_lattice(6, 1))
    wetted = {tuple(point) for point in np.round(channel.points[np.unique(channel.edges["interface"])], 9).tolist()}
    assert wetted <= {tuple(point) for point in np.round(wall, 9).tolist()}
    write_fluid(tmp_path / "fluid.mdpa", channel, {"DENSITY": 1.0})
    assert (tmp_path / "fluid.mdpa").read_text().count("Begin SubModelPart ") == 6


@pytest.mark.parametrize(("columns", "order"), [(1, 2), (2, 1)])
def test_elements_of_the_wall_fill_it_anticlockwise(tmp_path, columns, order):
    points = write_solid(tmp_path / "solid.mdpa", wall_lattice(6, columns, order), order)
    text = (tmp_path / "solid.mdpa").read_text()
    block = text.split(f"TotalLagrangianElement2D{4 * order}N\n")[1].split("End")[0].strip().splitlines()
    corners = points[np.array([line.split()[2:6] for line in block], dtype=int) - 1]
    (a, b, c, d) = corners.transpose(1, 2, 0)
    areas = 0.5 * ((c[0] - a[0]) * (d[1] - b[1]) - (d[0] - b[0]) * (c[1] - a[1]))
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(WALL_HEIGHT * (WALL[1] - WALL[0]), rel=1e-12)


def test_a_difference_is_a_share_of_the_largest_displacement(channel):
    control = moved(channel)
    apart = differences(control, moved(channel, 0.0808))
    assert apart == {"A": pytest.approx(0.01), "B": pytest.approx(0.01)}
    shorter = replace(control, times=control.times[:3], displacements=control.displacements[:3])
    assert min(differences(control, shorter).values()) == np.inf


def test_the_verdict_sees_an_inverted_cell_and_a_missed_history(channel):
    good = judged(moved(channel), channel.points, channel.triangles)
    bad = judged(moved(channel, push=0.5), channel.points, channel.triangles)
    assert (good.inverted, bad.inverted > 0) == (0, True)
    assert bad.worst_size_skew < 0.0 < good.worst_size_skew
    found = differences(moved(channel), moved(channel, 0.09))
    text = table({"one": good, "other": bad}, found, whole=True)
    assert "MISSED" in text
    assert "Mok (2001): largest u_x A 7.78 cm" in text


def test_without_kratos_it_says_how_to_install_it(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("KRATOS_PYTHON", "/nowhere/python")
    assert main(["--out", str(tmp_path)]) == os.EX_UNAVAILABLE
    assert "cannot be run" in capsys.readouterr().err
    stand_in = tmp_path / "python"
    stand_in.write_text("#!/bin/sh\necho \"ModuleNotFoundError: No module named 'KratosMultiphysics'\" >&2; exit 1\n")
    stand_in.chmod(0o755)
    monkeypatch.setenv("KRATOS_PYTHON", str(stand_in))
    assert main(["--out", str(tmp_path)]) == os.EX_UNAVAILABLE
    said = capsys.readouterr().err
    assert "No module named 'KratosMultiphysics'" in said
    assert "environment.sh" in said


def test_a_run_that_fails_is_reported_with_its_last_words(monkeypatch, tmp_path, capsys):
    stand_in = tmp_path / "python"
    stand_in.write_text('#!/bin/sh\n[ "$1" = -m ] || exit 0\necho "step 1 of 2"; echo "Error: diverged" >&2; exit 3\n')
    stand_in.chmod(0o755)
    monkeypatch.setenv("KRATOS_PYTHON", str(stand_in))
    assert main(["--out", str(tmp_path / "out"), "--wall", "6", "1", "2", "--coarsest", "0.12"]) == 1
    assert "status 3" in (said := capsys.readouterr().err)
    assert "Error: diverged" in said


@pytest.mark.nightly
def test_short_benchmark(tmp_path, capsys):
    """1.2 s of it, coarse: both mesh solvers, the same histories."""
    if execution.missing_kratos():
        pytest.skip("Kratos is not installed (adapters/kratos/README.md; KRATOS_PYTHON names its interpreter)")
    size = ["--end-time", "1.2", "--wall", "6", "1", "2", "--coarsest", "0.12"]
    assert main(["--out", str(tmp_path), *size]) == 0, capsys.readouterr()
    record = json.loads((tmp_path / "mok.json").read_text())
    assert max(record["differences"].values()) < 1e-3
    for outcome in record["runs"].values():
        assert outcome["inverted"] == 0
        assert 5e-4 < outcome["largest"]["A"] < 5e-3
    assert (tmp_path / "mok.png").stat().st_size > 10_000
    assert "met" in capsys.readouterr().out

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.case import read_case
from mesh_motion_server.cases.check import check
from mesh_motion_server.files import read_mesh, write_mesh


def test_every_key_of_the_format_is_taken(tmp_path: Path) -> None:
    """The case file as the format's description prints it."""
    path = tmp_path / "case.toml"
    path.write_text("""
[mesh]
file = "mesh.msh"          # relative to this file
[patches]                  # every boundary patch of the mesh has a role
block = "moving"
outer = "fixed"
[[motion]]
patch = "block"
rigid = { translation = [-0.2, -0.2], rotation = 60.0, centre = [0.5, 0.5] }
[[motion]]
patch = "block"
table = "motion.npz"
[steps]
count = 20
iterations = 1
[method]
basis = "wendland-c2"
support_radius = 0.5
displacement = "relative"
correction = "optimised"
enrichment_radius = 0.5
quality_metric = "size-skew"
quality_threshold = 0.2
max_enrichment_points = 20
reduction = "none"
refuse_below_threshold = true
""")
    case = read_case(path)
    assert case.mesh_path == tmp_path / "mesh.msh"
    assert case.content.patches == {"block": "moving", "outer": "fixed"}
    assert case.content.motion[0].rigid is not None
    assert case.content.motion[1].table == "motion.npz"
    assert case.content.method.refuse_below_threshold


def test_whole_numbers_serve_as_lengths_and_iterations_default_to_one(make_case) -> None:
    case = read_case(make_case(("[0.05, 0.02]", "[1, 0]"), ("0.6", "2")))
    assert case.content.method.support_radius == 2.0
    assert case.content.steps.iterations == 1


RIGID = "rigid = { translation = [0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5] }"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("support_radius", "suport_radius", "unknown key method.suport_radius; known here are basis, support_radius,"),
        ("[steps]", "[step]", "unknown key step; .* .did you mean 'steps'"),
        ("[steps]\ncount = 2", "", r"steps is missing \(add \[steps\] with count = 1\)"),
        ("count = 2", "count = 0", r"steps.count: expected greater than or equal to 1, got 0"),
        ("count = 2", "count = 2\niterations = 0", r"steps.iterations: expected greater than or equal to 1"),
        ("0.6", "-0.5", r"method.support_radius: expected a number greater than 0, got -0.5"),
        (
            '"none"',
            '"smooth"\ndisplacement = "relative"',
            "method.correction = 'smooth': expected displacement 'absolute'",
        ),
        ('"moving"', '"mobile"', r"patches.block: expected 'moving', 'fixed'.* got 'mobile'"),
        ("[0.05, 0.02]", "[nan, 0.02]", r"motion\[1\].rigid.translation\[1\]: expected a finite number, got nan"),
        ("[0.05, 0.02]", "[]", r"motion\[1\].rigid.translation: expected .*at least 1 item"),
        ("centre = [0.5, 0.5]", "center = [0.5, 0.5]", "unknown key motion.1..rigid.center; known here are tr"),
        (", centre = [0.5, 0.5]", "", "a rotation needs 'centre'"),
        ("rigid = {", "table = 'm.npz'\nrigid = {", "exactly one of 'rigid', 'oscillation', 'bending' and 'table'"),
        ("[mesh]", "[mesh", "not a TOML file"),
        ("count = 2", "count = 2\niteration = 3", r"unknown key steps.iteration; .* \(did you mean 'iterations'\?\)"),
        (RIGID, "oscillation = { amplitude = 0.1, frequency = 0.1 }", "give either 'direction' or 'centre'"),
        (RIGID, "oscillation = { amplitude = 0, frequency = 1, direction = [1, 0] }", "'amplitude' must not be zero"),
        (RIGID, "oscillation = { amplitude = 1, frequency = 1, direction = [0, 0] }", "'direction' must not be zero"),
        ('file = "mesh.npz"', "", "mesh.file is missing"),
        ('file = "mesh.npz"', 'file = ""', "mesh.file: expected"),
        ('file = "mesh.npz"', "file = 3", "mesh.file: expected a valid string, got 3"),
    ],
)
def test_a_wrong_entry_is_named_in_one_line(make_case, old: str, new: str, message: str) -> None:
    path = make_case((old, new))
    with pytest.raises(InvalidInput) as caught:
        read_case(path)
    text = str(caught.value)
    assert re.search(message, text)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text


def test_a_free_patch_is_left_out(make_case) -> None:
    """A set of all nodes, as finite-element programs write it, would be fixed, or move with the body."""
    path = make_case(('outer = "fixed"', 'outer = "fixed"\nall_nodes = "free"'))
    mesh = read_mesh(path.parent / "mesh.npz")
    write_mesh(
        path.parent / "mesh.npz", replace(mesh, patches={"all_nodes": np.arange(len(mesh.points)), **mesh.patches})
    )
    case = read_case(path)
    assert case.roles == {"block": "moving", "outer": "fixed"}
    assert list(case.read_mesh().patches) == ["block", "outer"]
    assert check(path).roles == case.roles


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('outer = "fixed"', "", r"patch 'outer' of mesh.npz has no role \(add  outer = \"fixed\"  to \[patches\]"),
        ('outer = "fixed"', 'outer = "fixed"\nwall = "fixed"', "no patch 'wall'; its patches are 'block', 'outer'"),
        ("[0.05, 0.02]", "[0.05, 0.02, 0.0]", "translation has 3 entries, but the mesh is 2D"),
        ("centre = [0.5, 0.5]", "centre = [0.5]", "centre has 1 entries"),
        ("rotation = 10.0", "rotation = 10.0, axis = [1, 0, 0]", "in 2D the only axis"),
        ("mesh.npz", "none.npz", "no such mesh file"),
        ('patch = "block"', 'patch = "wing"', "motion 1: unknown patch 'wing'"),
        ('patch = "block"', 'patch = "outer"', "motion 1: patch 'outer' has the role 'fixed'"),
        ('patch = "block"', 'patch = "blok"', r"unknown patch 'blok'; .* \(did you mean 'block'\?\)"),
        ('block = "moving"', 'blok = "moving"', r"no patch 'blok'; .* \(did you mean 'block'\?\)"),
        ('outer = "fixed"', 'outr = "fixed"', r"no patch 'outr'; .* \(did you mean 'outer'\?\)"),
        (RIGID, "oscillation = { amplitude = 1, frequency = 1, direction = [1, 0, 0] }", "direction has 3 entries"),
    ],
)
def test_the_case_has_to_fit_its_mesh(make_case, old: str, new: str, message: str) -> None:
    case = read_case(make_case((old, new)))
    with pytest.raises(InvalidInput, match=message) as caught:
        case.read_mesh()
    assert "\n" not in str(caught.value)


def test_a_missing_or_binary_case_file(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="cannot be read: No such file"):
        read_case(tmp_path / "none.toml")
    with pytest.raises(InvalidInput, match="cannot be read: Is a directory"):
        read_case(tmp_path)
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for name in ("pipe.toml", "zero.toml"):
        with pytest.raises(InvalidInput, match="cannot be read: it is a pipe or a device"):
            read_case(tmp_path / name)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidInput, match="not a TOML file"):
        read_case(tmp_path / "binary.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    with pytest.raises(InvalidInput, match="not a TOML file: values nested too deep to be read"):
        read_case(tmp_path / "deep.toml")
    (tmp_path / "long.toml").write_text("a = 1\n" + ".".join("b" * 100_000) + " = 1")
    with pytest.raises(InvalidInput, match=r"not a TOML file: a key of more than 100 dotted parts \(at line 2\)"):
        read_case(tmp_path / "long.toml")

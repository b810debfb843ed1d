import os
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_meshes import box_mesh
from frame_meshes import tensor_grid, without_unused
from mesh_motion_protocol.errors import InvalidInput
from periodic_meshes import periodic_box
from typer.testing import CliRunner

from mesh_motion_server.cases.case import Bending, read_case
from mesh_motion_server.cases.check import check
from mesh_motion_server.cases.draft import draft, guessed_roles, tried_draft
from mesh_motion_server.cases.motion_program import BendingProgram, MotionProgram
from mesh_motion_server.commands.app import app
from mesh_motion_server.files import MeshFile, read_mesh

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize(
    ("example", "roles"),
    [
        ("thesis_rotation", {"block": "moving", "outer": "fixed"}),
        ("tapered_wing", {"wing": "moving", "far": "fixed", "symmetry": "symmetry"}),
        ("sliding_piston", {"piston": "moving", "head": "fixed", "liner": "fixed"}),
    ],
)
def test_roles_are_guessed_by_name_and_place(example: str, roles: dict[str, str], tmp_path: Path) -> None:
    mesh = read_mesh(EXAMPLES / example / "mesh.npz")
    assert {name: role for name, (role, _) in guessed_roles(mesh).items()} == roles
    path = tmp_path / "case.toml"
    path.write_text(draft(mesh, tmp_path), encoding="utf-8")
    case = read_case(path)
    moved = MotionProgram.of(case, case.read_mesh()).displacement(10)
    assert np.abs(moved).max() > 0


def box_with_sides(folder: Path) -> MeshFile:
    """A box around a body; its sides x0 and x1, and y0 and y1, are images of each other."""
    points, cells, patches = periodic_box("quad")
    blocks = {f"cells_{block.type.name}": block.nodes for block in cells}
    np.savez(folder / "mesh.npz", points=points, **blocks, **{f"patch_{n}": p.nodes for n, p in patches.items()})
    return read_mesh(folder / "mesh.npz")


def roles_of(mesh: MeshFile) -> dict[str, str]:
    return {name: role for name, (role, _) in guessed_roles(mesh).items()}


@pytest.mark.parametrize("names", [("y0", "y1"), ("PERIODIC_1", "PERIODIC_2"), ("per1", "per2"), ("a.cyclic", "b.per")])
def test_periodic_sides_that_the_file_marks_or_names_are_periodic(tmp_path: Path, names: tuple[str, str]) -> None:
    mesh = box_with_sides(tmp_path)
    one, two = names
    patches = {dict(zip(("y0", "y1"), names, strict=True)).get(n, n): nodes for n, nodes in mesh.patches.items()}
    np.savez(tmp_path / "mesh.npz", points=mesh.points, cells_quad=mesh.cells["quad"],
             **{f"patch_{name}": nodes for name, nodes in patches.items()})  # fmt: skip
    marked = {"y0": "periodic", "y1": "periodic"} if one == "y0" else {}
    mesh = replace(mesh, patches=patches, marked=marked)
    assert roles_of(mesh) == {"body": "moving", "x0": "fixed", "x1": "fixed", one: "periodic", two: "periodic"}
    path = tmp_path / "case.toml"
    path.write_text(draft(mesh, tmp_path), encoding="utf-8")
    report = check(path)
    assert len(report.pairs) == 1
    assert not report.refused


def test_periodic_sides_without_an_image_are_fixed(tmp_path: Path) -> None:
    mesh = box_with_sides(tmp_path)
    others = {"body": "moving", "x0": "fixed", "x1": "fixed"}
    mesh = replace(mesh, marked={"y0": "periodic"})
    assert roles_of(mesh) == others | {"y0": "fixed", "y1": "fixed"}
    shorter = mesh.patches | {"y0": mesh.patches["y0"][1:]}
    mesh = replace(mesh, patches=shorter, marked=dict.fromkeys(("x0", "x1", "y0", "y1"), "periodic"))
    assert roles_of(mesh) == others | {"x0": "periodic", "x1": "periodic", "y0": "fixed", "y1": "fixed"}
    assert guessed_roles(mesh)["y0"][1] == "periodic by the file, but no other patch is its image"


@pytest.mark.parametrize("rows", [1, 2])
def test_a_set_of_all_nodes_is_free_if_one_is_inside(tmp_path: Path, rows: int) -> None:
    """Cubit's node sets of a whole block; all nodes of one row of cells are on the boundary."""
    points = np.array([(x, y) for y in range(rows + 1) for x in range(3)], float)
    quads = np.array([[k, k + 1, k + 4, k + 3] for row in range(rows) for k in (3 * row, 3 * row + 1)])
    patches = {"every": np.arange(len(points)), "low": np.arange(3)}
    roles = guessed_roles(MeshFile(points, {"quad": quads}, patches, tmp_path / "m.npz"))
    assert roles["every"][0] == ("free" if rows == 2 else "moving")
    assert list(roles) == ["every", "low"]


def test_words_that_only_look_periodic_are_not(tmp_path: Path) -> None:
    mesh = box_with_sides(tmp_path)
    names = {"y0": "upper_1", "y1": "paper2", "x0": "perforated", "x1": "temper"}
    mesh = replace(mesh, patches={names.get(name, name): nodes for name, nodes in mesh.patches.items()})
    assert set(roles_of(mesh).values()) == {"moving", "fixed"}


def test_symmetry_planes_that_the_file_marks_slip_if_they_are_curved(tmp_path: Path) -> None:
    mesh = replace(box_with_sides(tmp_path), marked={"y0": "symmetry", "y1": "symmetry"})
    raised = mesh.points.copy()
    y1 = mesh.patches["y1"]
    raised[y1, 1] += 0.03 * np.sin(np.pi * raised[y1, 0] / raised[:, 0].max())
    mesh = replace(mesh, points=raised)
    assert roles_of(mesh) == {"body": "moving", "x0": "fixed", "x1": "fixed", "y0": "symmetry", "y1": "slip"}
    np.savez(tmp_path / "mesh.npz", points=raised, cells_quad=mesh.cells["quad"],
             **{f"patch_{name}": nodes for name, nodes in mesh.patches.items()})  # fmt: skip
    (tmp_path / "case.toml").write_text(draft(mesh, tmp_path), encoding="utf-8")
    assert not check(tmp_path / "case.toml", seconds=5.0).refused


def numbers_of(value: object) -> list[float]:
    """All floats in a document."""
    if isinstance(value, float):
        return [value]
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [number for part in inner for number in numbers_of(part)]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 3e4])
def test_its_numbers_are_rounded_and_clamped_nodes_do_not_move(tmp_path: Path, scale: float) -> None:
    flap = layer(tmp_path / "mesh.npz", 2, two=True, flap=True)
    mesh = replace(flap, points=scale * (flap.points + np.array([0.1, 0.7, -0.3])))
    values = tomllib.loads(draft(mesh, tmp_path))
    assert "bending" in values["motion"][0]
    for number in numbers_of(values):
        assert len(repr(number).strip("-").replace(".", "").strip("0")) <= 12
        assert repr(number) != "-0.0"
    motion = Bending(**values["motion"][0]["bending"])
    clamped = mesh.points[np.intersect1d(mesh.patches["wall"], mesh.patches["rim"])]
    moved = BendingProgram(clamped, motion, lambda step: 1.0).displacement(1)
    assert np.abs(moved).max() <= 1e-10 * scale


def test_the_motions_in_its_comments_are_motions_too(make_case) -> None:
    path = make_case()
    text = draft(read_mesh(path.parent / "mesh.npz"), path.parent)
    lines = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# oscillation")]
    assert len(lines) == 2
    rigid = next(line for line in text.splitlines() if line.startswith("rigid"))
    for line in lines:
        path.write_text(text.replace(rigid, line), encoding="utf-8")
        case = read_case(path)
        assert np.abs(MotionProgram.of(case, case.read_mesh()).displacement(1)).max() > 0


def test_names_that_need_quotes_and_zones(make_case) -> None:
    folder = make_case().parent
    mesh = read_mesh(folder / "mesh.npz")
    odd = replace(mesh, patches={'a "wall"': mesh.patches["block"], "far field": mesh.patches["outer"]})
    values = tomllib.loads(draft(odd, folder, "2"))
    assert values["patches"] == {'a "wall"': "moving", "far field": "fixed"}
    assert values["motion"][0]["patch"] == 'a "wall"'
    assert values["mesh"] == {"file": "mesh.npz", "zone": "2"}


@pytest.mark.parametrize("name", ["a\x1b[31mb", "\x00", "\x7f", "\x9b5m", "a\nb", "12\u202f000", "\U0001f30a", 'a\\"b'])
def test_any_name_of_a_patch_can_be_read_again(make_case, name: str) -> None:
    folder = make_case().parent
    mesh = read_mesh(folder / "mesh.npz")
    text = draft(replace(mesh, patches={name: mesh.patches["block"]}), folder)
    assert list(tomllib.loads(text)["patches"]) == [name]
    assert all(letter.isprintable() or letter == "\n" for letter in text), "a terminal obeys none"


def test_a_file_whose_name_is_not_utf_8_is_refused(make_case) -> None:
    mesh = read_mesh(make_case().parent / "mesh.npz")
    with pytest.raises(InvalidInput, match="is not UTF-8"):
        draft(replace(mesh, path=mesh.path.with_name("m\udcff.npz")), mesh.path.parent)


def test_a_mesh_without_patches_gets_advice(make_case) -> None:
    mesh = read_mesh(make_case().parent / "mesh.npz")
    with pytest.raises(InvalidInput, match=r"no boundary patches.*physical groups"):
        draft(replace(mesh, patches={}), Path())


def test_init_writes_next_to_the_mesh_and_replaces_nothing(make_case) -> None:
    path = make_case()
    before = path.read_text(encoding="utf-8")
    refused = CliRunner().invoke(app, ["init", str(path.parent / "mesh.npz")])
    assert refused.exit_code == 2
    assert path.read_text(encoding="utf-8") == before
    path.unlink()
    written = CliRunner().invoke(app, ["init", str(path.parent / "mesh.npz")])
    assert written.exit_code == 0, written.output
    assert f"mesh-motion play {path}" in written.output
    assert os.listdir(path.parent).count("case.toml") == 1
    assert read_case(path).content.mesh.file == "mesh.npz"


def layer(path: Path, normal: int, *, two: bool, flap: bool = False) -> MeshFile:
    """One layer of a plane box, a tenth as high, with a body or a flap on its floor; its sides are one patch or two."""
    plane = box_mesh("quad", 10)
    y = plane.points[:, 1]
    body = np.flatnonzero((np.abs(plane.points[:, 0] - 0.5) < 0.11) & (y < 0.5)) if flap else plane.body
    cells = plane.cells.blocks[0].nodes
    cells = cells[~np.isin(cells, body).all(axis=1)]
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = plane.points[used], cells.reshape(-1, 4)
    n = len(points)
    patches = {"wall": np.flatnonzero(np.isin(used, body)), "rim": np.flatnonzero(np.isin(used, plane.outer))}
    patches = {name: np.r_[nodes, n + nodes] for name, nodes in patches.items()}
    patches |= {"front": np.arange(n), "back": n + np.arange(n)} if two else {"sides": np.arange(2 * n)}
    space = np.vstack([np.column_stack([points, np.full(n, z)]) for z in (0.0, 0.1)])
    np.savez(
        path,
        points=np.roll(space, normal + 1, axis=1),
        cells_hexahedron=np.hstack([cells, cells + n]),
        **{f"patch_{name}": nodes for name, nodes in patches.items()},
    )
    return read_mesh(path)


@pytest.mark.parametrize("flap", [False, True])
@pytest.mark.parametrize("two", [False, True])
@pytest.mark.parametrize("normal", [0, 1, 2])
def test_the_sides_of_one_layer_of_cells_are_a_symmetry(tmp_path: Path, normal: int, two: bool, flap: bool) -> None:
    """They do not move and do not hold the others, and the first motion lies in the plane."""
    mesh = layer(tmp_path / "mesh.npz", normal, two=two, flap=flap)
    sides = dict.fromkeys(["front", "back"] if two else ["sides"], "symmetry")
    assert {name: role for name, (role, _) in guessed_roles(mesh).items()} == {
        "wall": "moving", "rim": "fixed", **sides
    }  # fmt: skip
    path = tmp_path / "case.toml"
    path.write_text(draft(mesh, tmp_path), encoding="utf-8")
    case = read_case(path)
    moved = MotionProgram.of(case, case.read_mesh()).displacement(10)
    assert np.abs(np.delete(moved, normal, axis=1)).max() > 1e-3
    assert np.abs(moved[:, normal]).max() < 1e-12


def half(path: Path, turn: np.ndarray, *, flap: bool = False) -> MeshFile:
    """A turned box with half a body on its lowest side in the last direction, the patch "symmetry".

    A flap stands on the lowest side in the first direction, too, and has more nodes where it is thick.
    """
    d = len(turn)
    points, cells = tensor_grid(*[np.linspace(0.0, 1.0, 9)] * d)
    centre = points[cells].mean(axis=1)
    inside = (np.abs(centre[:, :-1] - 0.5) < 0.15).all(axis=1) & (centre[:, -1] < 0.3)
    if flap:
        inside = (centre[:, 0] < 0.6) & (np.abs(centre[:, 1] - 0.5) < 0.15) & (centre[:, 2] < 0.3)
    solid = np.isin(np.arange(len(points)), cells[inside])
    used = np.unique(cells[~inside])
    points, rest = without_unused(points, cells[~inside])
    body = np.flatnonzero(solid[used])
    walls = [np.flatnonzero(points[:, k] == 0.0) for k in range(d)]
    far = np.flatnonzero((points == 1.0).any(axis=1))
    patches = {"body": body, "symmetry": walls[-1], "far": far} | {f"wall{k}": walls[k] for k in range(d - 1)}
    points[:, -1] *= 1.0 + 0.2 * points[:, 0]
    cell = {2: "quad", 3: "hexahedron"}[d]
    np.savez(path, points=points @ turn.T, **{f"cells_{cell}": rest}, **{f"patch_{k}": v for k, v in patches.items()})
    return read_mesh(path)


def turn_by(degrees: float, axis: np.ndarray) -> np.ndarray:
    """The rotation about an axis (Rodrigues)."""
    angle, (x, y, z) = np.radians(degrees), axis / np.linalg.norm(axis)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across


@pytest.mark.parametrize("degrees", [0.0, 90.0, 33.0])
@pytest.mark.parametrize("body", ["in a plane", "in space", "flap"])
def test_the_first_motion_stays_in_the_symmetry_planes_that_a_body_touches(
    tmp_path: Path, degrees: float, body: str
) -> None:
    turn = turn_by(degrees, np.array([0.0, 0.0, 1.0]))[:2, :2]
    if body != "in a plane":
        turn = turn_by(degrees, np.array([1.0, -2.0, 0.5]))
    mesh = half(tmp_path / "mesh.npz", turn, flap=body == "flap")
    text = draft(mesh, tmp_path)
    assert ("bending" in tomllib.loads(text)["motion"][0]) == (body == "flap")
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    assert not check(path, seconds=5.0).refused
    moved = MotionProgram.of(read_case(path), mesh).displacement(10)
    assert np.abs(moved).max() > 1e-3


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("degrees", [0.0, 33.0])
def test_a_body_in_the_corner_of_symmetry_planes_stays(tmp_path: Path, d: int, degrees: float) -> None:
    """No translation keeps it on all of them; the file says so, and it is played."""
    turn = turn_by(degrees, np.array([0.0, 0.0, 1.0]) if d == 2 else np.array([1.0, -2.0, 0.5]))[:d, :d]
    points, cells = tensor_grid(*[np.linspace(0.0, 1.0, 7)] * d)
    points, cells = without_unused(points, cells[(points[cells].mean(axis=1) > 0.4).any(axis=1)])
    patches = {f"sym{k}": np.flatnonzero(points[:, k] == 0.0) for k in range(d)}
    patches |= {"body": np.flatnonzero((points < 0.4).all(axis=1)), "far": np.flatnonzero((points == 1.0).any(axis=1))}
    cell = {f"cells_{'quad' if d == 2 else 'hexahedron'}": cells}
    np.savez(tmp_path / "mesh.npz", points=points @ turn.T, **cell, **{f"patch_{k}": v for k, v in patches.items()})
    text = draft(read_mesh(tmp_path / "mesh.npz"), tmp_path)
    assert "no translation keeps it on them" in text
    assert tomllib.loads(text)["motion"][0]["rigid"]["translation"] == [0.0] * d
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    assert not check(tmp_path / "case.toml", seconds=5.0).refused


def test_a_patch_that_ends_at_one_periodic_side_does_not_move(tmp_path: Path) -> None:
    """An L: its lid ends at the right side, whose image has no lid."""
    points, cells = tensor_grid(np.linspace(0.0, 2.0, 9), np.linspace(0.0, 2.0, 9))
    centre = points[cells].mean(axis=1)
    points, cells = without_unused(points, cells[(centre < 1.0).any(axis=1)])
    x, y = points.T
    patches = {"left": (x == 0.0) & (y <= 1.0), "right": x == 2.0, "floor": y == 0.0, "top": y == 2.0}
    patches |= {"lid": (y == 1.0) & (x >= 1.0), "step": (x == 1.0) & (y >= 1.0), "other": (x == 0.0) & (y >= 1.0)}
    nodes = {f"patch_{name}": np.flatnonzero(on) for name, on in patches.items()}
    np.savez(tmp_path / "mesh.npz", points=points, cells_quad=cells, **nodes)
    mesh = replace(read_mesh(tmp_path / "mesh.npz"), marked={"left": "periodic", "right": "periodic"})
    assert [name for name, role in roles_of(mesh).items() if role == "moving"] == ["step"]
    (tmp_path / "case.toml").write_text(draft(mesh, tmp_path), encoding="utf-8")
    assert not check(tmp_path / "case.toml", seconds=5.0).refused


def below_the_lid(folder: Path, gap: float) -> Path:
    """A mesh with a body this far below the upper side, towards which the first draft shifts it by 0.02."""
    x = np.linspace(0.0, 1.0, 11)
    points, cells = tensor_grid(x, np.r_[x[:6], 0.6, 1.0 - gap, 1.0])
    centre = points[cells].mean(axis=1)
    solid = (np.abs(centre - (0.5, 0.8 - gap / 2)) < (0.2, 0.2 - gap / 2)).all(axis=1)
    kept, cells = without_unused(points, cells[~solid])
    outer = ((kept == 0.0) | (kept == 1.0)).any(axis=1)
    body = (np.abs(kept[:, 0] - 0.5) < 0.21) & (kept[:, 1] > 0.59) & ~outer
    np.savez(folder / "mesh.npz", points=kept, cells_quad=cells, patch_body=np.flatnonzero(body),
             patch_outer=np.flatnonzero(outer))  # fmt: skip
    return folder / "mesh.npz"


@pytest.mark.parametrize(("gap", "share"), [(0.1, 1.0), (0.015, 0.5), (0.004, 0.125)])
def test_init_writes_a_motion_that_the_mesh_can_follow(tmp_path: Path, gap: float, share: float) -> None:
    """A shift that crosses the lid is halved until it is accepted, also in the examples of other motions."""
    path = below_the_lid(tmp_path, gap)
    written = CliRunner().invoke(app, ["init", str(path)])
    assert "warning" not in written.output
    report = check(tmp_path / "case.toml", seconds=60.0)
    assert (report.steps, report.refused) == (10, "")
    text = (tmp_path / "case.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["motion"][0]["rigid"]["translation"] == [0.0, 0.02 * share]
    assert f"amplitude = {0.02 * share!r}," in text
    assert f"amplitude = {5.0 * share!r}," in text


def test_a_far_boundary_by_its_name_does_not_move_if_a_wall_can(tmp_path: Path) -> None:
    """A quarter of a ring: both arcs reach equally far inside the box."""
    radius, angle = (of.ravel() for of in np.meshgrid(np.linspace(1.0, 2.0, 5), np.linspace(0.0, np.pi / 2, 9)))
    _, cells = tensor_grid(np.arange(5.0), np.arange(9.0))
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    sides = {"farfield": radius == 2.0, "wall": radius == 1.0, "floor": angle == 0.0, "side": angle == np.pi / 2}
    nodes = {f"patch_{name}": np.flatnonzero(on) for name, on in sides.items()}
    np.savez(tmp_path / "mesh.npz", points=points, cells_quad=cells, **nodes)
    moving = [name for name, role in roles_of(read_mesh(tmp_path / "mesh.npz")).items() if role == "moving"]
    assert moving == ["wall"]


def test_init_says_why_a_mesh_cannot_be_moved(tmp_path: Path) -> None:
    path = below_the_lid(tmp_path, 0.1)
    with np.load(path) as file:
        arrays = dict(file)
    arrays["points"][0] += 0.15  # the corner's cell is inverted
    np.savez(path, **arrays)
    with pytest.raises(InvalidInput) as refused:
        check(path)
    written = CliRunner().invoke(app, ["init", str(path)])
    assert written.exit_code == 0
    assert f"warning: the drafted motion will be refused: {refused.value.message.split(': ', 1)[1]}" in written.output
    text = (tmp_path / "case.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["motion"][0]["rigid"]["translation"] == [0.0, 0.02]
    assert tried_draft(read_mesh(path), tmp_path / "case.toml")[0] == text

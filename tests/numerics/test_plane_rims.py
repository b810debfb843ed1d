"""Moving nodes on a plane wall stay on it: refused for a symmetry plane, a warning for a slip plane."""

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_protocol.errors import InvalidInput, QualityRefused


def piston(role: str, kind: str = "quad", *, disjoint: bool = False) -> MotionModel:
    """A box whose side x = 0 moves; the adjacent side y = 0 has the role, and may lack the common nodes."""
    points = (mesh := box_mesh(kind, 5)).points
    patches = {
        "piston": Patch("moving", np.flatnonzero(points[:, 0] == 0.0)),
        "wall": Patch(role, np.flatnonzero((points[:, 1] == 0.0) & ~(disjoint & (points[:, 0] == 0.0)))),
    }
    return MotionModel.build(points, mesh.cells, patches, Method(correction="none", allow_invalid=True))


def shifted(model: MotionModel, *shift: float) -> np.ndarray:
    return model.points[model.roles.moving] + np.resize([*shift, 0.0], model.points.shape[1])


@pytest.mark.parametrize("disjoint", [False, True])
@pytest.mark.parametrize("kind", ["quad", "tetra"])
def test_a_symmetry_plane_that_is_left_is_named(kind: str, disjoint: bool) -> None:
    model = piston("symmetry", kind, disjoint=disjoint)
    with pytest.raises(
        InvalidInput, match=r"moving node \d+ leaves the plane of the symmetry patch 'wall'.* 0\.1 off"
    ) as e:
        model.move(model.points, shifted(model, 0.01, -0.1))
    assert e.value.details["patch"] == "wall"
    assert model.points[e.value.details["node"], 1] == 0.0
    assert e.value.details["distance"] == pytest.approx(0.1)


def test_a_slip_plane_that_is_left_is_a_warning() -> None:
    model = piston("slip")
    warnings = model.move(model.points, shifted(model, 0.01, -0.1)).warnings
    assert any("leaves the plane of the slip patch 'wall': it is 0.1 off" in warning for warning in warnings)


@pytest.mark.parametrize("role", ["slip", "symmetry"])
@pytest.mark.parametrize("off", [0.0, 1e-7], ids=["in the plane", "single precision"])
def test_a_motion_in_the_plane_is_accepted_without_a_word(role: str, off: float) -> None:
    model = piston(role)
    assert model.move(model.points, shifted(model, 0.05, off)).warnings == []


@pytest.mark.parametrize("role", ["slip", "symmetry"])
@pytest.mark.parametrize("kind", ["quad", "hexahedron"])
@pytest.mark.parametrize("correction", ["none", "smooth"])
def test_a_body_that_passes_a_plane_names_its_patch(correction: str, kind: str, role: str) -> None:
    points = (mesh := box_mesh(kind, 5)).points
    low, high = (np.flatnonzero(points[:, 1] == end) for end in (0.0, 1.0))
    patches = {"body": Patch("moving", mesh.body), "low": Patch(role, low), "high": Patch(role, high)}
    patches["ends"] = Patch("fixed", np.setdiff1d(mesh.outer, np.r_[low, high]))
    model = MotionModel.build(points, mesh.cells, patches, Method(correction=correction))
    for shift, name in ((-0.6, "low"), (0.7, "high")):
        with pytest.raises(QualityRefused, match=rf"node \d+ passes the plane of the {role} patch '{name}'"):
            model.move(points, shifted(model, 0.0, shift))
    with pytest.raises(QualityRefused, match="no valid mesh exists") as caught:
        model.move(points, shifted(model, 0.9, 0.0))
    assert "passes" not in caught.value.message  # it leaves through the ends


@pytest.mark.parametrize("role", ["slip", "symmetry"])
def test_the_side_of_a_body_is_no_part_of_planes_that_are_one_cell_apart(role: str) -> None:
    """One layer of cells, whose planes lack the nodes of the body."""
    mesh = box_mesh("quad")
    n = len(mesh.points)
    points = np.vstack([np.column_stack([mesh.points, np.full(n, z)]) for z in (0.0, 0.1)])
    quads = next(iter(mesh.cells)).nodes
    cells = CellTable.from_arrays({"hexahedron": np.column_stack([quads, quads + n])})
    body, outer = (np.r_[nodes, nodes + n] for nodes in (mesh.body, mesh.outer))
    planes = np.setdiff1d(np.arange(2 * n), np.union1d(body, outer))
    patches = {"body": Patch("moving", body), "outer": Patch("fixed", outer), "planes": Patch(role, planes)}
    model = MotionModel.build(points, cells, patches, Method(correction="none"))
    moved = model.move(points, points[model.roles.moving] + [0.05, 0.02, 0.0])
    assert not any("leaves the plane" in warning for warning in moved.warnings)
    np.testing.assert_array_equal(moved.points[:, 2], points[:, 2])


def test_a_body_that_passes_a_plane_between_periodic_sides_names_its_patch() -> None:
    """With bent sides it is not proven that no mesh exists; the reason is the same."""
    points = (mesh := box_mesh("quad")).points
    sides = {f"{'xy'[axis]}{end}": np.flatnonzero(points[:, axis] == end) for axis in (0, 1) for end in (0, 1)}
    patches = {"body": Patch("moving", mesh.body)}
    patches |= {name: Patch("periodic" if name[0] == "x" else "slip", nodes) for name, nodes in sides.items()}
    model = MotionModel.build(points, mesh.cells, patches, Method())
    with pytest.raises(QualityRefused, match=r"node \d+ passes the plane of the slip patch 'y1'"):
        model.move(points, shifted(model, 0.0, 0.7))

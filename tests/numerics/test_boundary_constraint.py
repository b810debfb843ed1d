"""Sliding nodes in the optimised correction: they stay on their surface and within its rim, and improve the mesh."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_motion_numerics.correction.boundary_constraint import BoundaryConstraint
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from sliding_meshes import duct


def model_of(mesh, **choices) -> MotionModel:
    standard = {
        "quality_threshold": 0.9,
        "support_radius": 1.0,
        "displacement": "absolute",
        "correction_target": "maximum",
        "quality_metric": "size-skew",
    }
    return MotionModel.build(*mesh, Method(**{**standard, **choices}))


def moved(model: MotionModel, *shift: float) -> Motion:
    return model.move(model.points, model.points[model.roles.moving] + shift)


DUCTS = [("quad", 0.0), ("quad", 1.2), ("hexahedron", 0.0), ("wedge", 1.2)]


@pytest.mark.parametrize(("kind", "bend"), DUCTS)
def test_sliding_along_in_the_correction_is_better_than_staying(kind: str, bend: float) -> None:
    model = model_of(duct(kind, 5 if kind != "quad" else 10, bend=bend))
    shift = (0.12, 0.24, 0.0)[: model.cells.dimension]
    slid, stayed = moved(model, *shift), moved(replace(model, constraint=None), *shift)
    assert slid.corrected.metric.min > 1.05 * stayed.corrected.metric.min
    surfaces = model.standard_motion.sliding
    places = slid.points[surfaces.nodes]
    away = np.abs(surfaces.project(places) - places).max()
    assert away <= (0.0 if bend == 0.0 else 1e-15)
    assert model.constraint.facets.outward(slid.points).all()
    others = model.held & ~model.constraint.released
    np.testing.assert_array_equal(slid.points[others], stayed.points[others])
    assert np.abs(slid.points - stayed.points)[model.constraint.released].max() > 1e-3


def test_edges_of_a_box_stay_edges_and_corners_corners() -> None:
    points, cells, patches = duct("hexahedron", 5)
    sides = {name: replace(patch, role="slip") for name, patch in patches.items() if name != "body"}
    model = model_of((points, cells, {"body": patches["body"], **sides}))
    found = moved(model, 0.15, 0.15, 0.1).points
    on_side = (points == 0.0) | (points == 1.0)
    np.testing.assert_array_equal(found[on_side], points[on_side])
    assert ((found >= 0.0) & (found <= 1.0)).all()
    assert np.abs(found - points)[on_side.sum(axis=1) == 2].max() > 1e-3
    assert not model.constraint.released[on_side.all(axis=1)].any()


def test_two_slip_patches_in_one_plane_slide_as_one() -> None:
    """A far field that is divided into two patches: the mesh moves normally at the node between them."""
    points, cells, patches = duct("quad", 10)
    whole = moved(model_of((points, cells, patches)), 0.12, 0.24).points
    top = patches.pop("y1").nodes
    for name, nodes in (("left", top[points[top, 0] <= 0.5]), ("right", top[points[top, 0] >= 0.5])):
        patches[name] = replace(patches["y0"], nodes=nodes)
    cut = moved(model_of((points, cells, patches)), 0.12, 0.24).points
    np.testing.assert_array_equal(cut, whole)
    assert np.ptp(cut[top, 1]) == 0.0


def test_nodes_next_to_a_boundary_without_a_patch_stay() -> None:
    points, cells, patches = duct("quad", 10)
    del patches["x1"]
    model = model_of((points, cells, patches))
    rim = np.flatnonzero((points[:, 0] == 1.0) & ((points[:, 1] == 0.0) | (points[:, 1] == 1.0)))
    assert not model.constraint.released[rim].any()


def test_a_mesh_whose_sliding_nodes_are_all_corners_has_no_constraint() -> None:
    points, cells, patches = duct("quad", 10)
    corners = np.flatnonzero(((points == 0.0) | (points == 1.0)).all(axis=1))
    patches = {"body": patches["body"], "x0": patches["x0"], "x1": patches["x1"]}
    surfaces = model_of(duct("quad", 10)).standard_motion.sliding
    held = surfaces.of(np.isin(surfaces.nodes, corners))
    assert BoundaryConstraint.build(points, boundary_facets(cells), patches, {}, held, None) is None


def test_a_node_cannot_pass_its_neighbour() -> None:
    points, cells, patches = duct("quad", 10)
    constraint = model_of((points, cells, patches)).constraint
    assert constraint is not None
    passed = points.copy()
    top = patches["y1"].nodes[np.argsort(points[patches["y1"].nodes, 0])]
    passed[top[4], 0] = points[top[5], 0] + 0.01
    assert constraint.facets.outward(points).all()
    assert not constraint.facets.outward(passed).all()


def test_other_corrections_hold_sliding_nodes() -> None:
    model = model_of(duct("quad", 10), correction="enrichment", quality_threshold=0.6)
    found = moved(model, 0.12, 0.2)
    assert found.correction.method == "enrichment"
    plain = moved(replace(model, method=replace(model.method, correction="none")), 0.12, 0.2)
    np.testing.assert_array_equal(found.points[model.held], plain.points[model.held])

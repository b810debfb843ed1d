"""The participant's file: its allowed content, and the line that names the first fault."""

import json

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh
from mesh_motion_precice import nodes_at, read_configuration
from mesh_motion_precice.connectivity import cell_simplices, patch_facets
from mesh_motion_precice.participant import load_mesh


def test_a_file_is_read_with_its_defaults(case, tmp_path):
    configuration = read_configuration(case())
    assert configuration.precice_config == tmp_path / "script.json"
    assert configuration.participant == "MeshMotion"
    assert [surface.data for surface in configuration.surfaces] == ["Displacement"] * 2
    assert (configuration.volume.data, configuration.volume.received) == ("NodeDisplacement", False)
    assert configuration.method == {"support_radius": 0.8}
    assert load_mesh(configuration).patches["upper"].role == "moving"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("[write]", "[wirte]"), "unknown table 'wirte'"),
        (('mesh = "Volume"', 'maesh = "Volume"'), "unknown key write.maesh; known are mesh, data, received, velocity"),
        (('mesh = "Volume"', "received = true"), "write.mesh is missing"),
        (('mesh = "Volume"', 'mesh = "Volume"\nreceived = "yes"'), "write.received: expected true or false, got 'yes'"),
        (('mesh = "Volume"', "mesh = 3"), "write.mesh: expected a name, got 3"),
        (('mesh = "Volume"', 'mesh = "Upper"'), "the preCICE mesh 'Upper' is named twice"),
        (('patch = "upper"', 'patch = "lower"'), r"read\[2\]: patch 'lower' is read already"),
        (('patch = "upper"', 'patch = "outer"'), r"read\[2\]: patch 'outer' is none of the moving ones: lower, upper"),
        (('outer = "fixed"', 'outer = "moving"'), "the moving patch 'outer' has no"),
        (('outer = "fixed"', 'outer = "free"'), "patches.outer: expected one of moving"),
        (("[coupling]", '[coupling]\nframe = "total"'), "coupling.frame must be one of reference, committed"),
        (("[coupling]", "[coupling]\ntime_step = 0.0"), "coupling.time_step must be positive"),
        (("[coupling]", "[coupling]\ntime_step = true"), "coupling.time_step: expected a number"),
        (("[coupling]", '[coupling]\nvelocity_scheme = "bdf3"'), "must be one of bdf1, bdf2, bossak, got 'bdf3'"),
        (("[coupling]", '[coupling]\nvelocity_scheme = "bdf2"\ntime_step = 0.05'), "a window must be one step"),
        (("[mesh]", "[mesh"), "mesh-motion.toml is not a TOML file"),
    ],
)
def test_the_first_offender_is_named(change, words, case):
    text = case().read_text()
    assert text.count(change[0]) == 1
    with pytest.raises(InvalidInput, match=words) as raised:
        read_configuration(case(text=text.replace(*change)))
    assert "mesh-motion.toml" in str(raised.value)


def test_patches_of_the_mesh_and_of_the_file_agree(case, tmp_path):
    path = case()
    path.write_text(path.read_text().replace('outer = "fixed"', ""))
    with pytest.raises(InvalidInput, match=r"mesh\.npz: patch 'outer' has no role"):
        load_mesh(read_configuration(path))
    (tmp_path / "mesh.npz").unlink()
    with pytest.raises(InvalidInput, match="No such file"):
        load_mesh(read_configuration(path))


@pytest.fixture
def adapter_config(case, tmp_path):
    """Writes precice-adapter-config.json, and next to it a TOML file without the same keys."""

    def write(change=("", ""), more=""):
        text = case().read_text()
        own = ("precice]", "[read]", "write]")
        kept = [part for part in text.split("\n[") if not part.startswith(own)]
        (tmp_path / "case.toml").write_text("\n[".join(kept) + more)
        values = {
            "participant_name": "MeshMotion",
            "precice_config_file_path": "script.json",
            "interfaces": [
                {
                    "mesh_name": "Lower",
                    "patches": ["lower"],
                    "location": "nodes",
                    "read_data": [{"name": "Displacement"}],
                },
                {"mesh_name": "Upper", "patches": ["upper"], "read_data": [{"name": "Displacement"}]},
                {
                    "mesh_name": "Volume",
                    "is_received": True,
                    "write_data": [{"name": "NodeDisplacement"}, {"name": "V", "solver_name": "velocity"}],
                },
            ],
            "mesh-motion": {"case": "case.toml"},
        }
        path = tmp_path / "precice-adapter-config.json"
        path.write_text(json.dumps(values).replace(*change))
        return path

    return write


def test_the_adapter_configuration_of_precice_s_guidelines_says_the_same(adapter_config, case):
    expected = read_configuration(case(volume='received = true\nvelocity = "V"'))
    assert read_configuration(adapter_config()) == expected


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"mesh_name"', '"mesh"'), "unknown key 'mesh' in interfaces"),
        (('"nodes"', '"faceCenters"'), r"interfaces\[1\].location: expected nodes, got 'faceCenters'"),
        (('["lower"]', '["lower", "upper"]'), r"interfaces\[1\]: what is read needs one entry"),
        (('"write_data"', '"read_data"'), r"interfaces\[3\]: what is read needs"),
        (('"velocity"', '"speed"'), "expected solver_name displacement or velocity, got 'speed'"),
        (('"participant_name"', '"participant"'), "unknown key 'participant' in the file"),
        (('"case"', '"file"'), "unknown key 'file' in mesh-motion"),
        (('"case.toml"', '"none.toml"'), "none.toml cannot be read"),
        (('"Volume"', "7"), "write.mesh: expected a name, got 7"),
        (('["lower"]', "3"), "a value does not have the type"),
        (("{", "["), "not a JSON file"),
    ],
)
def test_the_first_offender_of_the_adapter_configuration_is_named(change, words, adapter_config):
    with pytest.raises(InvalidInput, match=words):
        read_configuration(adapter_config(change))


def test_nothing_is_said_in_both_files(adapter_config):
    with pytest.raises(InvalidInput, match=r"\[write\] is in .*case.toml and also in this file"):
        read_configuration(adapter_config(more='[write]\nmesh = "Volume"\n'))


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_nodes_are_found_at_their_places(dimension):
    """Displaced by less than a thousandth of the distance to the next node, and by more."""
    random = np.random.default_rng(dimension)
    points = np.unique(np.round(random.random((3000, dimension)), 4), axis=0) * 40.0 + 1e3
    order = random.permutation(len(points))
    blur = 1e-6 * random.uniform(-1.0, 1.0, points.shape)
    np.testing.assert_array_equal(nodes_at(points[order] + blur, points, "mesh"), order)
    beyond = points[order].copy()
    beyond[7, 0] += 1e-2 if dimension > 1 else 2e-3
    with pytest.raises(InvalidInput, match="vertex 7 of mesh"):
        nodes_at(beyond, points, "mesh")


def test_a_far_field_of_500_chords_has_cells_of_a_millionth():
    """Coordinates with 12 digits: the loss is large at the far field and small at the wall."""
    layers = 1e-6 * 1.2 ** np.arange(112)
    radius = 0.5 + np.concatenate([[0.0], np.cumsum(layers)])
    assert radius[-1] > 500.0
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    points = np.stack([np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=1)
    written = np.array([[float(f"{value:.12g}") for value in row] for row in points])
    np.testing.assert_array_equal(nodes_at(written, points, "mesh"), np.arange(len(points)))


def test_nodes_at_one_place_are_refused():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    assert nodes_at(np.array([[0.0, 0.0]]), points, "mesh").tolist() == [0]
    with pytest.raises(InvalidInput, match="are both there"):
        nodes_at(np.array([[1.0, 0.0]]), points, "mesh")


def cell(kind):
    """Corners of a cell of this type, from the unit cube."""
    x, y, z, o = np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.zeros(3)
    return {
        "tetra": [o, x, y, z],
        "pyramid": [o, x, x + y, y, z],
        "wedge": [o, x, y, z, x + z, y + z],
        "hexahedron": [o, x, x + y, y, z, x + z, x + y + z, y + z],
    }[kind]


@pytest.mark.parametrize(
    ("kind", "volume", "facets"),
    [("tetra", 1 / 6, 4), ("pyramid", 1 / 3, 6), ("wedge", 1 / 2, 8), ("hexahedron", 1, 12)],
)
def test_simplices_fill_a_cell_and_facets_close_it(kind, volume, facets):
    points = np.array(cell(kind))
    mesh = Mesh(points, {kind: np.arange(len(points))[None]})
    corners = points[cell_simplices(mesh)]
    sizes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert (np.abs(sizes) > 0.0).all()
    assert np.abs(sizes).sum() == pytest.approx(volume)
    found = patch_facets(mesh, np.arange(len(points)))
    assert len(found) == facets
    a, b, c = (points[found[:, k]] for k in range(3))
    inside = points.mean(axis=0)
    outward = np.cross(b - a, c - a) * np.sign(np.einsum("ij,ij->i", np.cross(b - a, c - a), a - inside))[:, None]
    np.testing.assert_allclose(outward.sum(axis=0), 0.0, atol=1e-15)  # a closed surface


def test_a_patch_has_the_edges_of_the_boundary(square):
    nodes = square.patches["lower"].nodes
    edges = patch_facets(square, nodes)
    ends = square.points[nodes[edges]]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) == pytest.approx(0.1)  # sides of cells, no diagonals
    assert len(edges) == len(nodes) - 1
    assert len(cell_simplices(square)) == len(square.cells["triangle"])

"""The participant's file: what it may say, and the line that names the first offender."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_motion_client import InvalidInput
from mesh_motion_precice import nodes_at, read_configuration
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
        (('mesh = "Volume"', 'maesh = "Volume"'), "unknown key write.maesh; known are mesh, data, received"),
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
        (("[mesh]", "[mesh"), "not a TOML file"),
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
    with pytest.raises(InvalidInput, match=r"must have the patches of .*lower, outer, upper.*'outer'"):
        load_mesh(read_configuration(path))
    (tmp_path / "mesh.npz").unlink()
    with pytest.raises(InvalidInput, match="no such mesh file"):
        load_mesh(read_configuration(path))


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_nodes_are_found_at_their_places(dimension):
    """Blurred by less than the tolerance, shifted and scaled; and beyond it not."""
    random = np.random.default_rng(dimension)
    points = np.unique(np.round(random.random((3000, dimension)), 6), axis=0) * 40.0 + 1e3
    order = random.permutation(len(points))
    blur = 3e-8 * random.uniform(-1.0, 1.0, points.shape)
    np.testing.assert_array_equal(nodes_at(points[order] + blur, points, "mesh"), order)
    beyond = points[order].copy()
    beyond[7, 0] += 1e-7
    with pytest.raises(InvalidInput, match="vertex 7 of mesh"):
        nodes_at(beyond, points, "mesh")


def test_nodes_at_one_place_cannot_be_told_apart():
    with pytest.raises(InvalidInput, match="two nodes"):
        nodes_at(np.zeros((1, 2)), np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]), "mesh")

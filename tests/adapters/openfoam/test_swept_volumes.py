"""Swept volumes against OpenFOAM's ``meshPhi``, face by face.

OpenFOAM divides a face around its centre, this code around the mean of its corners: the two are equal if a face is
plane before and after the step, and a triangle always is.
"""

from pathlib import Path

import numpy as np
import pytest
from foam_cases import BOX, PRISMS, FoamCase
from mesh_motion_numerics.mesh.swept_volumes import swept_volumes

SOURCE = Path(__file__).with_name("swept_faces.C")
AFFINE = np.array([[1.1, 0.3, -0.2], [-0.25, 0.9, 0.1], [0.05, 0.2, 1.2]])


@pytest.fixture(scope="module")
def program(tmp_path_factory, compile_foam):
    libraries = "-Wl,--no-as-needed", "-lfiniteVolume", "-lmeshTools", "-lOpenFOAM"
    return compile_foam(SOURCE, tmp_path_factory.mktemp("swept") / "swept_faces", *libraries)


def moved_by_openfoam(case, program, motion):
    """Points before and after, the faces padded with -1, and their swept volumes."""
    case.run("blockMesh")
    rows = (case.folder / "constant/polyMesh/points").read_text().split("\n(\n")[1].split("\n)")[0].splitlines()
    points = np.array([[float(x) for x in row.strip("()").split()] for row in rows])
    after = motion(points)
    text = "\n".join(f"({x!r} {y!r} {z!r})" for x, y, z in after.tolist())
    (case.folder / "moved").write_text(f"{len(after)}\n(\n{text}\n)\n")
    case.run(str(program), "out")
    lines = (case.folder / "out").read_text().splitlines()
    before = np.array([line.split() for line in lines[: len(points)]], dtype=float)
    faces, swept = np.full((len(lines) - len(points), 4), -1), []
    for row, line in zip(faces, lines[len(points) :], strict=True):
        *nodes, volume = line.split()
        row[: len(nodes)] = list(map(int, nodes))
        swept.append(float(volume))
    return before, after, faces, np.array(swept)


@pytest.mark.nightly
def test_plane_faces_sweep_what_openfoam_says(tmp_path, program):
    case = FoamCase.new(tmp_path / "box", BOX)
    before, after, faces, theirs = moved_by_openfoam(case, program, lambda x: x @ AFFINE.T + [0.3, -0.1, 0.2])
    ours = swept_volumes(before, after, faces)
    assert np.abs(theirs).max() > 1e-3
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-15)


@pytest.mark.nightly
def test_triangles_sweep_what_openfoam_says(tmp_path, program):
    """A quad whose corners are not in one plane has another volume here and there: each is right for its own cells."""
    numbers = np.random.default_rng(6)
    case = FoamCase.new(tmp_path / "prisms", PRISMS)
    before, after, faces, theirs = moved_by_openfoam(
        case, program, lambda x: x + 0.05 * numbers.standard_normal(x.shape)
    )
    ours = swept_volumes(before, after, faces)
    triangles = faces[:, 3] < 0
    assert np.count_nonzero(triangles) > 10
    np.testing.assert_allclose(ours[triangles], theirs[triangles], rtol=0, atol=1e-15)
    assert np.abs(ours - theirs)[~triangles].max() < 0.2 * np.abs(ours).max()

"""The boundary of a mesh from the facets of its partitions' boundaries."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.merging import merge
from tests.faults.stand_in import grid_mesh, split_mesh


def at_client(mesh, role="slip"):
    """The boundary of a partition whose cells stay with the client."""
    facets = boundary_facets(CellTable.from_arrays({name: np.asarray(rows) for name, rows in mesh.cells.items()}))
    kept = {name: np.empty((len(rows), 0), dtype=np.int64) for name, rows in mesh.cells.items()}
    patches = {name: Patch("moving" if patch.role == "moving" else role, patch.nodes)
               for name, patch in mesh.patches.items()}  # fmt: skip
    return replace(mesh, cells=kept, facets=facets, patches=patches)


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_facets_of_only_one_partition_are_the_boundary(parts: int) -> None:
    whole = grid_mesh(6)
    expected = merge([whole])
    found = merge([at_client(one) for one in (split_mesh(whole, parts) if parts > 1 else [whole])])
    lines = boundary_facets(expected.cells)["line"]
    np.testing.assert_array_equal(found.facets["line"], lines[np.lexsort(np.sort(lines, axis=1).T[::-1])])


def test_facets_that_cannot_be_are_named() -> None:
    one, other = (at_client(part) for part in split_mesh(grid_mesh(6), 2))
    rows = one.facets["line"]
    twice = replace(one, facets={"line": np.concatenate([rows, rows[3:4, ::-1]])})
    ids = sorted(one.global_ids[rows[3]].tolist())
    with pytest.raises(InvalidInput) as refused:
        merge([twice, other])
    assert f"global ids [{ids[0]}, {ids[1]}]: partition 0 sent it twice" in refused.value.message
    between = np.flatnonzero(np.isin(one.global_ids[rows], other.global_ids).all(axis=1))
    assert len(between)
    third = replace(one, cells={}, patches={}, facets={"line": rows[between[:1]]})
    with pytest.raises(InvalidInput, match="more than two partitions have it"):
        merge([one, other, third])
    with pytest.raises(InvalidInput, match=r"facets 'line', row 0: node index 999 is not in"):
        merge([replace(one, facets={"line": rows * 0 + 999}), other])


def test_roles_that_need_facets_name_the_partition_without_them() -> None:
    one, other = (at_client(part) for part in split_mesh(grid_mesh(6), 2))
    with pytest.raises(InvalidInput, match=r"has the role 'slip', .*: partition 1 sent no facets") as refused:
        merge([one, replace(other, facets={})])
    assert refused.value.details["partition"] == 1
    fixed = [replace(at_client(part, "fixed"), facets={}) for part in split_mesh(grid_mesh(6), 2)]
    assert merge(fixed).facets == {}

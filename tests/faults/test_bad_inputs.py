"""Bad inputs are refused as their rows say, extreme ones are accepted, and a server with fewer checks is detected."""

import math
from collections import Counter
from typing import Any

import pytest
from mesh_motion_numerics.mesh import patch_check
from mesh_motion_numerics.motion import method_check
from mesh_motion_numerics.quality import mesh_check
from mesh_motion_protocol import shared_nodes
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.service import move
from mesh_motion_server.session import motions, session
from mesh_motion_server.session.partitions import merging, uploads
from tests.faults.inputs.extremes import EXTREMES
from tests.faults.numerical_input import BAD_INPUTS, prove_bad_inputs, prove_extreme_inputs


def rows(*starts: str) -> list[Any]:
    found = [row for row in BAD_INPUTS if row.name.startswith(starts)]
    assert found
    return found


def test_every_bad_input_is_refused_as_its_row_says_and_leaves_no_trace() -> None:
    verdicts = prove_bad_inputs(1)
    assert verdicts.wrong == {}
    assert verdicts.right == verdicts.cases == len(BAD_INPUTS)


def test_the_table_is_as_large_as_promised_and_meets_every_request() -> None:
    assert len(BAD_INPUTS) >= 170
    assert len({row.name for row in BAD_INPUTS}) == len(BAD_INPUTS)
    assert min(Counter(row.where for row in BAD_INPUTS).values()) >= 40
    assert len(EXTREMES) >= 35


def test_an_extreme_input_that_is_refused_is_found(monkeypatch: Any) -> None:
    monkeypatch.setattr(move, "_FARTHEST", 1e3)
    carried = [row for row in EXTREMES if row.name == "carried far away"]
    assert "INVALID_ARGUMENT.VALUE" in prove_extreme_inputs(carried).wrong["carried far away"]


def nothing(*args: Any, **kwargs: Any) -> None:
    """A check that was forgotten."""


@pytest.mark.parametrize(
    ("owner", "check", "names"),
    [
        (uploads, "_check_finite", ("node at nan",)),
        (uploads, "_check_cell_type", ("'tetra' cells", "'line' cells")),
        (merging, "_check_range", ("a cell with node -1", "a patch with node 25")),
        (merging, "_check_no_duplicate", ("a cell twice",)),
        (mesh_check, "_refuse_geometry", ("an inverted cell", "a folded mesh")),
        (mesh_check, "_check_extent", ("square × 1e+200", "cube × 1e-120")),
        (patch_check, "_check_nodes", ("a fixed patch without nodes",)),
        (method_check, "_check_lengths", ("square at build with support_radius = 1e+300",)),
        (method_check, "_check_periodic", ("periodic at build with basis = tps",)),
        (move, "check_values", ("displacement × 1e+300",)),
    ],
)
def test_a_forgotten_check_is_found(monkeypatch: Any, owner: Any, check: str, names: tuple[str, ...]) -> None:
    monkeypatch.setattr(owner, check, nothing)
    chosen = rows(*names)
    assert {row.name for row in chosen} <= set(prove_bad_inputs(0, chosen).wrong)


def test_partitions_that_may_disagree_are_found(monkeypatch: Any) -> None:
    monkeypatch.setattr(shared_nodes, "AGREEMENT", math.inf)
    assert prove_bad_inputs(0, rows("partitions that disagree")).wrong


def test_a_wrong_number_of_the_offender_is_found(monkeypatch: Any) -> None:
    monkeypatch.setattr(motions, "in_senders_numbers", lambda error, mesh: InvalidInput("node 7", code=error.code))
    assert prove_bad_inputs(0, rows("periodic images")).right == 0


def test_a_refusal_that_leaves_something_behind_is_found(monkeypatch: Any) -> None:
    honest = session.Session.move

    def leaky(self: Any, frame: str, displacements: Any, **choices: Any) -> Any:
        try:
            return honest(self, frame, displacements, **choices)
        except Exception:
            points = self._now.committed.points.copy()
            points[0] += 1e-16
            self._now.committed.__dict__["points"] = points
            raise

    monkeypatch.setattr(session.Session, "move", leaky)
    wrong = prove_bad_inputs(0, rows("the body outside")).wrong
    assert "committed state changed" in wrong["the body outside"]


def test_a_lost_code_is_found(monkeypatch: Any) -> None:
    monkeypatch.setattr(method_check, "_unfit", lambda setting, message, hint="": InvalidInput(message))
    assert prove_bad_inputs(0, rows("square at build with support_radius = 1e+300")).right == 0

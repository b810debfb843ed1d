"""The state table: complete, and exactly what it says."""

import pytest
from mesh_motion_protocol.errors import SessionError

from mesh_motion_server.session.state import TABLE, Operation, Refusal, State, admit

#: What is allowed, written out a second time: state → operation → state afterwards.
ALLOWED = {
    "NEW": "JOIN NEW, STATUS NEW, UPLOAD OPENING, CLOSE CLOSED, RESUME NEW, LEASE_END CLOSED",
    "OPENING": "JOIN OPENING, STATUS OPENING, UPLOAD OPENING, BUILD READY, CLOSE CLOSED, RESUME OPENING, "
    "LEASE_END CLOSED",
    "READY": "JOIN READY, STATUS READY, FETCH READY, TANGENT READY, COTANGENT READY, MOVE TRIAL, ROLLBACK READY, "
    "CLOSE CLOSED, RESUME READY, "
    "LEASE_END SUSPENDED",
    "TRIAL": "JOIN TRIAL, STATUS TRIAL, FETCH TRIAL, TANGENT TRIAL, COTANGENT TRIAL, MOVE TRIAL, JUDGE TRIAL, "
    "CORRECT TRIAL, COMMIT READY, "
    "ROLLBACK READY, CLOSE CLOSED, RESUME READY, LEASE_END SUSPENDED",
    "COMMITTING": "STATUS COMMITTING, LEASE_END COMMITTING",
    "SUSPENDED": "JOIN READY, STATUS SUSPENDED, CLOSE CLOSED, RESUME READY, LEASE_END SUSPENDED",
    "FROZEN": "JOIN FROZEN, STATUS FROZEN, FETCH FROZEN, CLOSE CLOSED, LEASE_END FROZEN",
    "FAILED": "JOIN FAILED, STATUS FAILED, CLOSE CLOSED, LEASE_END FAILED",
    "CLOSED": "LEASE_END CLOSED",
}
EXPECTED = {
    State(state): {Operation(a.split()[0]): State(a.split()[1]) for a in row.split(", ")}
    for state, row in ALLOWED.items()
}
CELLS = [(state, operation) for state in State for operation in Operation]


@pytest.mark.parametrize(("state", "operation"), CELLS, ids=str)
def test_every_cell(state: State, operation: Operation) -> None:
    after = EXPECTED[state].get(operation)
    if after is not None:
        assert admit(state, operation) is after
        return
    with pytest.raises(SessionError) as caught:
        admit(state, operation)
    assert f"{operation} is not allowed in state {state}: " in caught.value.message
    assert caught.value.hint
    assert caught.value.details == {"state": str(state), "operation": str(operation)}
    disk = state is State.FROZEN
    assert caught.value.code == ("RESOURCE_EXHAUSTED.DISK" if disk else "FAILED_PRECONDITION.STATE")


def test_the_table_is_complete_and_cannot_be_changed() -> None:
    assert set(TABLE) == set(State)
    assert all(set(row) == set(Operation) for row in TABLE.values())
    with pytest.raises(TypeError):
        TABLE[State.NEW][Operation.MOVE] = State.READY  # type: ignore[index]


def test_a_refusal_says_why_and_what_to_do() -> None:
    refusals = {cell for row in TABLE.values() for cell in row.values() if isinstance(cell, Refusal)}
    assert all(refusal.message and refusal.hint for refusal in refusals)

"""The state table is complete, and each refusal gives a reason."""

import pytest
from mesh_motion_protocol.errors import SessionError

from mesh_motion_server.session.state import TABLE, Operation, Refusal, State, admit

REFUSED = [(state, o) for state, row in TABLE.items() for o, cell in row.items() if isinstance(cell, Refusal)]


@pytest.mark.parametrize(("state", "operation"), REFUSED, ids=str)
def test_refused_operations_name_the_state(state: State, operation: Operation) -> None:
    """The row of the state machine tests the content of the cells."""
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

"""Exactly once: stored replies, conflicts, and what is bounded."""

from __future__ import annotations

import pytest

from mesh_motion_server.errors import SessionError
from mesh_motion_server.session.replies import ReplyTable, RequestId


def ask(sequence: int, content: bytes = b"x", client: bytes = b"c") -> RequestId:
    return RequestId(client, sequence, content)


def test_a_repeat_gets_the_stored_reply() -> None:
    table: ReplyTable[str] = ReplyTable(3, 1000)
    assert table.find(ask(1)) is None
    table.store(ask(1), "one", 10)
    assert table.find(ask(1)) == "one"
    assert table.find(ask(1, client=b"d")) is None


def test_other_content_conflicts_also_after_a_failure() -> None:
    table: ReplyTable[str] = ReplyTable(3, 1000)
    table.store(ask(1), "one")
    table.store(ask(2), None)
    assert table.find(ask(2)) is None
    for sequence in (1, 2):
        with pytest.raises(SessionError, match=f"request {sequence} was already made") as caught:
            table.find(ask(sequence, b"y"))
        assert caught.value.code == "ABORTED.CONFLICT"


def test_what_was_dropped_is_stale() -> None:
    table: ReplyTable[str] = ReplyTable(3, 1000)
    for sequence in range(1, 6):
        table.store(ask(sequence), str(sequence))
    assert [table.find(ask(s)) for s in (3, 4, 5)] == ["3", "4", "5"]
    with pytest.raises(SessionError, match="older than the replies kept") as caught:
        table.find(ask(2))
    assert caught.value.code == "ABORTED.STALE"
    assert caught.value.details == {"sequence": 2, "oldest": 3}


def test_behind_the_largest_number_there_is_none() -> None:
    """Found by the handlers' fuzz: the detail did not fit into 64 bits, and its reply into no header."""
    table: ReplyTable[str] = ReplyTable(1, 1000)
    for sequence in (2**63 - 1, 5):
        table.store(ask(sequence), "reply")
    with pytest.raises(SessionError) as caught:
        table.find(ask(6))
    assert caught.value.details == {"sequence": 6, "oldest": 2**63 - 1}


def test_bytes_are_bounded_but_each_holder_keeps_its_newest() -> None:
    table: ReplyTable[str] = ReplyTable(10, 100, holders=3)
    for sequence in range(1, 8):
        for client in (b"c", b"d", b"e"):
            table.store(ask(sequence, client=client), "reply", 40)
    assert table.nbytes == 120
    assert all(table.find(ask(7, client=client)) == "reply" for client in (b"c", b"d", b"e"))


def test_clients_that_hold_the_session_no_more_keep_nothing_beyond_the_budget() -> None:
    table: ReplyTable[str] = ReplyTable(2, 100)
    for number in range(50):
        for sequence in (1, 2):
            table.store(ask(sequence, client=b"%d" % number), "reply", 40)
    assert table.nbytes == 80
    assert table.find(ask(2, client=b"49")) == "reply"
    with pytest.raises(SessionError, match="older than the replies kept"):
        table.find(ask(2, client=b"48"))
    table.store(ask(3, client=b"49"), "long", 1000)
    assert (table.nbytes, table.find(ask(3, client=b"49"))) == (1000, "long")


def test_clients_are_bounded() -> None:
    table: ReplyTable[str] = ReplyTable(2, 10_000_000)
    for number in range(5000):
        table.store(ask(1, client=number.to_bytes(16)), "reply", 10)
    assert table.nbytes == 1024 * 10


def test_storing_again_replaces() -> None:
    table: ReplyTable[str] = ReplyTable(2, 1000)
    table.store(ask(1), None)
    table.store(ask(1), "done", 7)
    assert table.find(ask(1)) == "done"
    assert table.nbytes == 7

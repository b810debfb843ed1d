"""Exactly-once execution: stored replies, conflicts, and limits."""

import tracemalloc

import pytest
from mesh_motion_protocol.errors import SessionError

from mesh_motion_server.session.journal.replies import ReplyTable, RequestId


def ask(sequence: int, content: bytes = b"x", client: bytes = b"c") -> RequestId:
    return RequestId(client, sequence, content)


def test_other_content_conflicts_also_after_a_failure() -> None:
    table: ReplyTable[str] = ReplyTable(3, 1000)
    table.store(ask(1), "one")
    table.store(ask(2), None)
    assert table.find(ask(2)) is None
    for sequence in (1, 2):
        with pytest.raises(SessionError, match=f"request {sequence} was already sent") as caught:
            table.find(ask(sequence, b"y"))
        assert caught.value.code == "ABORTED.CONFLICT"


def test_a_dropped_reply_is_stale() -> None:
    table: ReplyTable[str] = ReplyTable(3, 1000)
    for sequence in range(1, 6):
        table.store(ask(sequence), str(sequence))
    assert [table.find(ask(s)) for s in (3, 4, 5)] == ["3", "4", "5"]
    with pytest.raises(SessionError, match="older than the replies kept") as caught:
        table.find(ask(2))
    assert caught.value.code == "ABORTED.STALE"
    assert caught.value.details == {"sequence": 2, "oldest": 3}


def test_a_request_between_dropped_ones_is_stale_in_any_order_of_their_numbers() -> None:
    table: ReplyTable[str] = ReplyTable(1, 1000)
    for sequence in (9, 3, 12):  # the reply to 9 is dropped first, then the one to 3
        table.store(ask(sequence), str(sequence))
    for sequence in (3, 5, 9):
        with pytest.raises(SessionError, match="older than the replies kept") as caught:
            table.find(ask(sequence))
        assert caught.value.details["oldest"] == 10


def test_no_number_follows_the_largest_one() -> None:
    """A fault that the handlers' fuzz found: the detail did not fit into 64 bits, so its reply fitted into no
    header.
    """
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


def test_the_longest_silent_client_is_forgotten_first() -> None:
    table: ReplyTable[str] = ReplyTable(2, 10_000_000)
    for number in range(1024):
        table.store(ask(1, client=number.to_bytes(16)), "reply")
    table.store(ask(2, client=bytes(16)), "the first comes again")
    table.store(ask(1, client=b"new"), "reply")
    found = [number for number in range(1024) if table.find(ask(1, client=number.to_bytes(16))) is None]
    assert found == [1]
    assert table.find(ask(1, client=b"new")) == "reply"


def test_holders_are_those_that_were_answered_last() -> None:
    table: ReplyTable[str] = ReplyTable(2, 100, holders=1)
    for client in (b"c", b"d", b"c"):
        table.store(ask(1, client=client), "reply", 60)
    assert table.find(ask(1, client=b"c")) == "reply"
    with pytest.raises(SessionError, match="older than the replies kept"):
        table.find(ask(1, client=b"d"))


def test_replies_that_just_fit_the_budget_are_kept() -> None:
    table: ReplyTable[str] = ReplyTable(10, 100)
    for sequence in (1, 2, 3):
        table.store(ask(sequence), "reply", 50)
    assert (table.nbytes, table.find(ask(2)), table.find(ask(3))) == (100, "reply", "reply")


def test_a_client_without_replies_takes_next_to_nothing() -> None:
    table: ReplyTable[str] = ReplyTable(64, 64)
    tracemalloc.start()
    for number in range(200):
        for sequence in range(1, 65):
            table.store(ask(sequence, client=number.to_bytes(16)), "reply", 1)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert table.nbytes == 64
    assert taken < 200 * 1000


def test_storing_again_replaces() -> None:
    table: ReplyTable[str] = ReplyTable(2, 1000)
    table.store(ask(1), None)
    for size in (9, 7):
        table.store(ask(1), "done", size)
        assert table.find(ask(1)) == "done"
        assert table.nbytes == size

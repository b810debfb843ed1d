"""Remembered control requests, and their clients."""

import pytest
from mesh_motion_protocol.errors import SessionError
from mesh_motion_protocol.messages import Open

from mesh_motion_server.transport import registry
from mesh_motion_server.transport.registry import RequestBook

CLIENT = bytes(16)


def opening(sequence: int, dimension: int = 2) -> Open:
    return Open(client=CLIENT, sequence=sequence, dimension=dimension, settings={})


def answer(book: RequestBook, user: str, sequence: int) -> None:
    asked, new = book.enter(b"peer", user, opening(sequence))
    assert new
    asked.reply = b"opened"


@pytest.fixture
def book(monkeypatch: pytest.MonkeyPatch) -> RequestBook:
    monkeypatch.setattr(registry, "_REMEMBERED", 3)
    return RequestBook()


def test_the_latest_of_each_user_are_remembered(book: RequestBook) -> None:
    answer(book, "anna", 1)
    for sequence in range(1, 100):
        answer(book, "bert", sequence)
    known, new = book.enter(b"elsewhere", "anna", opening(1))
    assert (known.reply, known.peer, new) == (b"opened", b"elsewhere", False)
    assert [book.enter(b"peer", "bert", opening(sequence))[1] for sequence in (97, 98, 99)] == [False] * 3
    assert book.enter(b"peer", "bert", opening(96))[1]


def test_a_waiting_request_is_not_forgotten(book: RequestBook) -> None:
    waiting, _ = book.enter(b"peer", "anna", opening(1))
    for sequence in range(2, 100):
        answer(book, "anna", sequence)
    assert book.enter(b"peer", "anna", opening(1)) == (waiting, False)
    with pytest.raises(SessionError) as conflict:
        book.enter(b"peer", "anna", opening(1, dimension=3))
    assert conflict.value.code == "ABORTED.CONFLICT"


def test_a_repeat_after_a_refusal_is_a_new_request(book: RequestBook) -> None:
    for user in ("anna", "bert"):
        asked, _ = book.enter(b"peer", user, opening(1))
        book.forget(asked)
        book.forget(asked)
    assert book._users == {}
    assert book.enter(b"peer", "anna", opening(1))[1]

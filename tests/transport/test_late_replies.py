"""Delayed replies: due at a fixed time after their request, for any duration of the search."""

from types import SimpleNamespace

import pytest

from mesh_motion_server.transport import late_replies
from mesh_motion_server.transport.late_replies import LateReplies


class Clock:
    """A clock that stands still except in sleeps."""

    def __init__(self) -> None:
        self.now = 100.0

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(late_replies, "time", SimpleNamespace(monotonic=lambda: clock.now, sleep=clock.sleep))
    return clock


def test_a_reply_is_sent_a_fixed_time_after_its_question(clock: Clock) -> None:
    sent: list[tuple[float, bytes]] = []
    late = LateReplies(lambda _, frame: sent.append((clock.now, frame)))
    assert late.next_due() is None
    for lookup in (0.0, 0.03):
        late.asked()
        asked = clock.now
        clock.sleep(lookup)
        late.put(b"peer", b"frame")
        late.send_due(clock.now)
        assert sent == []
        due = late.next_due()
        assert due == pytest.approx(asked + 0.048)  # a little before: the rest is slept
        clock.now = due
        late.send_due(clock.now)
        assert sent.pop() == (pytest.approx(asked + 0.05), b"frame")


def test_replies_are_sent_in_the_order_of_their_questions(clock: Clock) -> None:
    sent: list[bytes] = []
    late = LateReplies(lambda _, frame: sent.append(frame))
    for frame in (b"1", b"2", b"3"):
        late.asked()
        late.put(b"peer", frame)
        clock.sleep(0.01)
    late.send_due(100.05)
    assert sent == [b"1"]
    late.send_due(101.0)
    assert sent == [b"1", b"2", b"3"]
    assert late.next_due() is None

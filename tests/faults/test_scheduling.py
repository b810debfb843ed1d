"""What the kernel counts of a process' turns."""

import os

from tests.faults.scheduling import Turns, turns_of


def test_turns_of_this_process_grow() -> None:
    before = turns_of(os.getpid())
    sum(range(100_000))
    os.sched_yield()
    after = turns_of(os.getpid())
    assert after.ran >= before.ran
    assert after.count >= before.count
    assert turns_of(0) == Turns(0.0, 0.0, 0)


def test_averages() -> None:
    assert Turns(1.5, 0.25, 7).since(Turns(1.0, 0.0, 2)) == {"turns": 5.0, "ran_ms": 100.0, "waited_ms": 50.0}
    assert Turns(1.0, 0.0, 2).since(Turns(1.0, 0.0, 2)) == {"turns": 1.0, "ran_ms": 0.0, "waited_ms": 0.0}

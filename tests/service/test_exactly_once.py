"""A request executes once, however often it is sent: also over a kill and a resume."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import Move, Upload
from raising import raising


@pytest.mark.parametrize("point", ["session.upload.taken", "request.unstored"])
def test_a_part_that_was_taken_and_refused_is_not_there_twice(driver: Any, plan_fault: Any, point: str) -> None:
    driver.join()
    driver.ask(Upload, item="nodes", rows=np.zeros((1, 2)))
    plan_fault(f"{point}=raise:MemoryError@2")
    assert driver.ask(Upload, item="nodes", rows=np.ones((2, 2))).code == "RESOURCE_EXHAUSTED.MEMORY"
    assert driver.ask(Upload, item="nodes", rows=np.ones((2, 2))).rows_total == 3


def test_a_reply_cannot_be_changed_by_its_receiver(ready: Any) -> None:
    (moved,) = ready.move(1)
    assert not moved.displacement.flags.writeable


def test_what_was_executed_is_known_even_if_counting_it_fails(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    move = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    monkeypatch.setattr("mesh_motion_server.service.recorder._count", raising(KeyError("metric")))
    ready.send(move)
    assert ready.send(move)[0].type == "MOVED"
    assert ready.host.iteration == 1

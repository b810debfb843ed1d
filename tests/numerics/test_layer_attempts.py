"""Which part of a boundary layer the next attempt keeps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from mesh_motion_numerics.motion.boundary_layer_fallback import LayerAttempts
from mesh_motion_protocol.errors import QualityRefused

THRESHOLD = 0.2
#: Below a fifth of it a mesh is nearly inverted.
NEARLY_INVERTED, GOOD = 0.01, 0.15


class Layer:
    """Gives way once near cells, then everywhere."""

    def __init__(self, times: int = 1) -> None:
        self.times, self.near = times, list[int]()

    def without_near(self, cells: Any) -> Layer | None:
        self.near = list(cells)
        return Layer(self.times - 1) if self.times else None


def motion(minimum: float, *worst: int) -> Any:
    cells = [SimpleNamespace(number=number) for number in worst]
    return SimpleNamespace(corrected=SimpleNamespace(metric=SimpleNamespace(min=minimum), worst=cells))


def attempts(layer: Layer | None, **choices: float) -> Any:
    return LayerAttempts(layer, THRESHOLD, **choices)  # type: ignore[arg-type]


def test_without_a_layer_there_is_one_attempt() -> None:
    found = attempts(None)
    found.accepted(motion(-0.1))
    assert found.over
    refusal = QualityRefused("no valid mesh found")
    with pytest.raises(QualityRefused) as raised:
        attempts(None).refused(refusal)
    assert raised.value is refusal


def test_a_refused_layer_gives_way_near_its_cells_and_then_everywhere() -> None:
    layer, last = Layer(), motion(GOOD)
    found = attempts(layer)
    found.refused(QualityRefused("", cells=[7, 8]))
    assert layer.near == [7, 8]
    assert found.layer is not None
    found.refused(QualityRefused("", cells=[9]))
    assert found.layer is None
    assert not found.over
    found.accepted(last)
    assert found.answer == (last, None)


@pytest.mark.parametrize(("plain", "kept"), [(1.9 * NEARLY_INVERTED, True), (2.1 * NEARLY_INVERTED, False)])
def test_a_layer_in_a_nearly_inverted_mesh_goes_if_that_doubles_the_quality(plain: float, kept: bool) -> None:
    layer = Layer(0)
    found = attempts(layer)
    found.accepted(motion(NEARLY_INVERTED, 3))
    assert layer.near == [3]
    assert not found.over
    found.accepted(motion(plain))
    assert found.over
    assert (found.answer[1] is layer) == kept


def test_a_layer_that_costs_more_quality_than_it_may_is_left_out() -> None:
    found, plain = attempts(Layer(), least=0.16), motion(0.165)
    found.accepted(motion(GOOD))
    assert (found.over, found.layer) == (False, None)
    found.accepted(plain)
    assert found.answer == (plain, None)

"""The table of keys: its types, its ranges, and its references to other tables."""

from typing import Any

import pytest
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.method import KEYS, Method

from mesh_motion_server.settings import MethodSettings


def test_there_are_at_most_thirteen_choices() -> None:
    assert len(KEYS) <= 13
    assert all(key.admits(key.default) for key in KEYS.values())
    assert all(key.meaning.endswith(".") and key.when.endswith(".") for key in KEYS.values())


def test_bases_are_those_that_can_be_used_and_reductions_take_the_definite_ones() -> None:
    usable = {name for name, basis in BASES.items() if not basis.unusable}
    assert set(KEYS["basis"].choices) == usable
    definite = {name for name in usable if not BASES[name].needs_polynomial}
    for needs in KEYS["reduction"].needs.values():
        assert set(needs["basis"]) == definite


@pytest.mark.parametrize(
    ("named", "correction", "displacement"),
    [
        ({}, "smooth", "absolute"),
        ({"quality_threshold": 0.3, "support_radius": 0.5}, "smooth", "absolute"),
        ({"displacement": "absolute"}, "smooth", "absolute"),
        ({"displacement": "reanchored"}, "smooth", "reanchored"),
        ({"correction": "smooth"}, "smooth", "absolute"),
        ({"displacement": "relative"}, "optimised", "relative"),
        ({"correction": "none"}, "none", "relative"),
        ({"correction": "optimised"}, "optimised", "relative"),
        ({"correction_target": "maximum"}, "optimised", "relative"),
        ({"quality_metric": "size-skew"}, "optimised", "relative"),
        ({"reduction": "greedy", "displacement": "absolute"}, "optimised", "absolute"),
    ],
)
def test_keys_that_are_left_out_are_chosen(named: dict[str, Any], correction: str, displacement: str) -> None:
    """A coupled run needs no setting; a key of another kind of motion chooses that kind, as before."""
    method = Method(**named)
    assert (method.correction, method.displacement) == (correction, displacement)
    settings = MethodSettings.from_mapping(named)
    assert settings.to_method() == method
    assert settings.model_dump()["correction"] == correction  # stored so: a later version computes the same

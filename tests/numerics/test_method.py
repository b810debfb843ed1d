"""The table of keys: its types, its ranges, and what it says of other tables."""

import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.interpolation.kernels import BASES
from mesh_motion_server.numerics.method import KEYS, Method


def test_nobody_has_to_choose_among_more_than_eighteen() -> None:
    assert len(KEYS) <= 18
    assert all(key.admits(key.default) for key in KEYS.values())
    assert all(key.meaning.endswith(".") and key.when.endswith(".") for key in KEYS.values())


def test_bases_are_those_that_can_be_used_and_reductions_take_the_definite_ones() -> None:
    usable = {name for name, basis in BASES.items() if not basis.unusable}
    assert set(KEYS["basis"].choices) == usable
    definite = {name for name in usable if not BASES[name].needs_polynomial}
    for needs in KEYS["reduction"].needs.values():
        assert set(needs["basis"]) == definite


@pytest.mark.parametrize(
    ("choices", "says"),
    [
        ({"support_radius": 0.0}, "support_radius: expected a number greater than 0, got 0.0"),
        ({"support_radius": True}, "support_radius: expected a number greater than 0, got True"),
        ({"quality_threshold": float("nan")}, "quality_threshold: expected a number from -1 to 1, got nan"),
        ({"quality_threshold": None}, "quality_threshold: expected a number from -1 to 1, got None"),
        ({"max_control_points": 1.0}, "max_control_points: expected an integer from 0 to 1000000, got 1.0"),
        ({"allow_invalid": 1}, "allow_invalid: expected true or false, got 1"),
        ({"correction": "best"}, "correction: expected one of none, smooth, imposed-gradient, .*, got 'best'"),
        (
            {"correction": "smooth", "displacement": "relative"},
            "smooth': expected displacement 'absolute' or 'reanchored', got",
        ),
        ({"reduction": "greedy", "basis": "mqb"}, "reduction = 'greedy': expected basis .* or 'gauss', got 'mqb'"),
    ],
)
def test_what_is_refused(choices: dict[str, object], says: str) -> None:
    with pytest.raises(InvalidInput, match=says) as caught:
        Method(**choices)  # type: ignore[arg-type]
    assert caught.value.code == "INVALID_ARGUMENT.SETTINGS"
    assert caught.value.details == {"setting": next(iter(choices))}

"""Header fields against their declarations, one by one."""

from typing import Any

import pytest
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import Move, Upload
from mesh_motion_protocol.schema import FieldSpec, check_value, schema_of


def refused(value: Any, kind: Any) -> str:
    with pytest.raises(ProtocolError) as caught:
        check_value(value, FieldSpec("f", kind, (), required=True), finite=True)
    return caught.value.code


@pytest.mark.parametrize(
    ("value", "kind"),
    [([1, "a"], list[int]), ([[1], [1.5]], list[list[int]]), ({"a": 1, "b": "c"}, dict[str, int]), (object(), Any),
     ({"a": {"b": object()}}, dict[str, Any]), ([1, {2}], list)],
)  # fmt: skip
def test_values_inside_maps_and_arrays_are_checked_too(value: Any, kind: Any) -> None:
    assert refused(value, kind) == "INVALID_ARGUMENT.HEADER"


@pytest.mark.parametrize(
    ("value", "kind"), [([1, 2], list[int]), ({"a": [None, 1.5, b""]}, dict[str, Any]), (3, float)]
)
def test_right_values_pass(value: Any, kind: Any) -> None:
    check_value(value, FieldSpec("f", kind, (), required=True), finite=True)


def test_the_wide_dtypes_of_an_array_come_first() -> None:
    move, (rows,) = schema_of(Move).arrays[0], schema_of(Upload).arrays
    assert move.dtypes == ("<f8", "<f4")
    assert rows.dtypes == ("<f8", "<i8", "<f4", "<i4")

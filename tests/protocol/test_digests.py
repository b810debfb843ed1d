"""Request digests separate a repeat from a conflict; the state digest is the one SPEC.md defines."""

import hashlib
import struct
from dataclasses import replace

import msgpack
import numpy as np
import pytest
from mesh_motion_protocol.digests import request_digest, state_digest
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import Commit, Move, Open, Upload

MOVE = Move(
    client=b"c" * 16, sequence=1, session="s", epoch=1, frame="committed", step=1, displacement=np.array([[1.0, 2.0]])
)


@pytest.mark.parametrize(
    ("message", "change"),
    [
        (MOVE, {"client": b"d" * 16, "sequence": 2, "epoch": 5, "displacement": MOVE.displacement.copy()}),
        (MOVE, {"compute_limit_ms": 500}),
        (MOVE, {"memory": {"process": 1}}),
        # A client that repeats a COMMIT may know another end of its run by then.
        (Commit(session="a" * 32, epoch=1, step=1, final_step=40), {"final_step": 50}),
    ],
)
def test_sender_and_way_of_the_reply_are_not_content(message, change):
    assert request_digest(replace(message, **change)) == request_digest(message)


@pytest.mark.parametrize(
    "change",
    [
        {"step": 2},
        {"partition": 1},
        {"frame": "reference"},
        {"session": "t"},
        {"displacement": np.array([[1.0, 2.0000000000000004]])},
        {"displacement": np.array([[1.0], [2.0]])},
    ],
)
def test_everything_else_is(change):
    assert request_digest(replace(MOVE, **change)) != request_digest(MOVE)


def test_the_order_of_a_map_is_not_content():
    one, two = (
        Open(dimension=2, settings={"a": 1, "b": {"c": 1, "d": 2}}),
        Open(dimension=2, settings={"b": {"d": 2, "c": 1}, "a": 1}),
    )
    assert request_digest(one) == request_digest(two)


def test_a_value_that_the_wire_does_not_know_has_no_digest():
    with pytest.raises(ProtocolError, match="the header cannot be packed: Integer value out of range"):
        request_digest(Open(client=b"c" * 16, sequence=1, dimension=2, settings={"max_enrichment_points": 2**64}))


def test_an_absent_array_is_one_zero_byte():
    fields = {"item": "nodes", "name": "", "partition": 0, "role": "", "session": "s"}
    text = msgpack.packb(["UPLOAD", fields]) + b"\0"
    assert request_digest(Upload(session="s", epoch=1, item="nodes")) == hashlib.sha256(text).digest()


def test_state_digest_is_the_sha256_of_the_text_in_the_spec():
    points = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, -5.5]])
    text = b"mesh-motion state 1\n" + struct.pack("<3q", 12, 3, 2) + struct.pack("<6d", 0, 1, 2, 3, 4, -5.5)
    assert state_digest(12, points) == hashlib.sha256(text).digest()
    assert state_digest(12, np.asfortranarray(points)) == state_digest(12, points)


@pytest.mark.parametrize("rows", [2, 40_000])
def test_narrow_and_wide_numbers_are_the_same_content(rows):
    cells = np.arange(4 * rows).reshape(rows, 4)
    wide, narrow = (
        Upload(session="s", epoch=1, item="cells", name="tetra", rows=cells.astype(d)) for d in ("i8", "<i4")
    )
    text = msgpack.packb(["UPLOAD", {"item": "cells", "name": "tetra", "partition": 0, "role": "", "session": "s"}])
    text += msgpack.packb(["rows", "<i8", [rows, 4]]) + cells.tobytes()
    assert request_digest(wide) == request_digest(narrow) == hashlib.sha256(text).digest()

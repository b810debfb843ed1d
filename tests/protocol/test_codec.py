"""Messages to frames and back, with arrays of every kind, and frames of every wrong kind."""

import tracemalloc

import hypothesis.extra.numpy as hnp
import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.limits import FRAME_BYTES
from mesh_motion_protocol.messages import Fetched, Joined, Move, Moved, Open, Ping, StatusReport, Upload

AT = {"client": b"c" * 16, "sequence": 3, "session": "ab" * 16, "epoch": 1}
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)


def over_the_wire(message):
    return decode([bytes(frame) for frame in encode(message)])


@given(hnp.arrays("<f8", hnp.array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=3).filter(lambda s: s[1] >= 1)))
def test_displacements_come_back_bitwise(displacement):
    moved = over_the_wire(Move(**AT, frame="committed", step=1, displacement=displacement))
    assert moved.displacement.dtype == np.float64
    assert moved.displacement.shape == displacement.shape
    assert moved.displacement.tobytes() == displacement.tobytes()


@given(st.dictionaries(st.text(max_size=8), PLAIN, max_size=5))
def test_maps_come_back(report):
    status = StatusReport(state="READY", step=1, iteration=0, waiting_for=[1, 2], report=report)
    assert over_the_wire(status).report == report


@pytest.mark.parametrize(
    ("rows", "make", "adopted"),
    [
        (100_000, bytearray, True),
        (100_000, bytes, False),
        (100_000, lambda frame: memoryview(bytearray(b"x" + bytes(frame)))[1:], False),
        (1_000, bytearray, False),
        (FRAME_BYTES // 16, bytearray, True),
        ((1 << 20) // 16, bytearray, True),
    ],
    ids=["large", "read-only", "misaligned", "small", "a whole frame", "just large enough"],
)
def test_a_large_frame_becomes_its_array(rows, make, adopted):
    sent = np.arange(2.0 * rows).reshape(rows, 2)
    header, frame = encode(Move(**AT, frame="committed", step=1, displacement=sent))
    given = make(frame)
    tracemalloc.start()
    moved = decode([header, given]).displacement
    allocated = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.shares_memory(moved, np.frombuffer(given, dtype=np.uint8)) == adopted
    assert moved.flags.aligned
    assert moved.flags.writeable
    assert (allocated < sent.nbytes) == adopted
    np.testing.assert_array_equal(moved, sent)
    assert moved.dtype == np.float64


def test_four_byte_values_in_a_large_frame_are_widened():
    sent = np.arange(1 << 20, dtype="<f4").reshape(-1, 2)
    header, frame = encode(Move(**AT, frame="committed", step=1, displacement=sent))
    moved = decode([header, bytearray(frame)]).displacement
    assert moved.dtype == np.float64
    np.testing.assert_array_equal(moved, sent)


def test_narrow_arrays_are_widened():
    move = over_the_wire(Move(**AT, frame="committed", step=1, displacement=np.array([[0.1, 0.2]], dtype=np.float32)))
    assert move.displacement.dtype == np.float64
    assert (move.displacement == np.array([[0.1, 0.2]], dtype=np.float32)).all()
    joined = over_the_wire(Joined(state="READY", step=0, iteration=0, moving_nodes=np.array([1, 2], dtype=np.int32)))
    assert joined.moving_nodes.dtype == np.int64


def test_the_cells_of_a_mesh_stay_narrow():
    cells = np.arange(1 << 19, dtype=np.int32).reshape(-1, 4)
    header, frame = encode(Upload(**AT, item="cells", name="tetra", rows=cells))
    given = bytearray(frame)
    rows = decode([header, given]).rows
    assert rows.dtype == np.int32
    assert np.shares_memory(rows, np.frombuffer(given, dtype=np.uint8))
    np.testing.assert_array_equal(rows, cells)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", [">f8", "<f8"])
def test_memory_order_and_byte_order_of_the_sender_do_not_show(order, dtype):
    array = np.asarray(np.arange(6.0).reshape(3, 2), dtype=dtype, order=order)
    frames = [bytes(frame) for frame in encode(Move(**AT, frame="committed", step=1, displacement=array))]
    assert frames[1] == np.arange(6, dtype="<f8").tobytes()


def test_a_strided_view_is_sent_as_it_reads():
    array = np.arange(24.0).reshape(6, 4)[::2, 1:3]
    assert (over_the_wire(Move(**AT, frame="committed", step=1, displacement=array)).displacement == array).all()


def test_large_arrays_travel_in_chunks_of_the_frame_size():
    rows = 2 * FRAME_BYTES // 8 + 5
    array = np.arange(rows, dtype=np.int64).reshape(-1, 1)
    frames = encode(Upload(**AT, item="cells", name="line", rows=array))
    assert [len(frame) for frame in frames[1:]] == [FRAME_BYTES, FRAME_BYTES, 40]
    assert (decode(frames).rows == array).all()
    with pytest.raises(ProtocolError, match=f"must have {FRAME_BYTES} bytes"):
        decode([frames[0], frames[1][:-8], bytes(frames[2]) + b"\0" * 8, frames[3]])


def test_message_bytes_bounds_all_arrays_together():
    arrays = {"displacement": np.zeros((10, 2)), "enrichment_points": np.zeros((10, 2))}
    frames = encode(Moved(step=1, iteration=1, quality={}, correction={}, caches={}, seconds={}, warnings=[], **arrays))
    assert decode(frames, message_bytes=320).step == 1
    with pytest.raises(ProtocolError, match="may have 319 bytes, got 320"):
        decode(frames, message_bytes=319)


def test_an_array_that_may_be_left_out_and_one_that_may_not():
    frames = encode(Upload(**AT, item="nodes"))
    assert len(frames) == 1
    assert decode(frames).rows is None
    with pytest.raises(ProtocolError) as caught:
        encode(Move(**AT, frame="committed", step=1, displacement=None))
    assert caught.value.code == "INVALID_ARGUMENT.DTYPE"


def test_non_finite_numbers_pass_in_replies_only():
    points = np.array([[np.nan, np.inf]])
    assert np.isnan(over_the_wire(Fetched(step=0, points=points)).points[0, 0])
    report = over_the_wire(StatusReport(state="", step=0, iteration=0, waiting_for=[], report={"x": float("inf")}))
    assert report.report == {"x": float("inf")}
    with pytest.raises(ProtocolError, match=r"settings\.radius must be finite, got inf"):
        encode(Open(client=b"c" * 16, sequence=1, dimension=2, settings={"radius": float("inf")}))


def test_numpy_scalars_and_tuples_become_plain():
    report = {"a": np.float64(0.5), "b": np.int32(3), "c": (1, 2), "d": np.bool_(True), "e": {"f": np.float32(0.25)}}
    came = over_the_wire(StatusReport(state="", step=np.int64(0), iteration=0, waiting_for=[], report=report))
    assert came.report == {"a": 0.5, "b": 3, "c": [1, 2], "d": True, "e": {"f": 0.25}}


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (Move(**AT, frame="committed", step=1, displacement=np.zeros(4)), "INVALID_ARGUMENT.SHAPE"),
        (Move(**AT, frame="committed", step=1, displacement=np.zeros((2, 4))), "INVALID_ARGUMENT.SHAPE"),
        (Move(**AT, frame="committed", step=1, displacement=np.zeros((2, 2), dtype=complex)), "INVALID_ARGUMENT.DTYPE"),
        (Move(**AT, frame="committed", step=1, displacement=np.zeros((2, 2), dtype=int)), "INVALID_ARGUMENT.DTYPE"),
        (Move(**AT, frame="committed", step=-1, displacement=np.zeros((2, 2))), "INVALID_ARGUMENT.VALUE"),
        (Move(**AT, frame="committed", step="1", displacement=np.zeros((2, 2))), "INVALID_ARGUMENT.HEADER"),
        (Open(dimension=2, settings={"x": object()}), "INVALID_ARGUMENT.HEADER"),
        (Open(dimension=2, settings={1: "x"}), "INVALID_ARGUMENT.HEADER"),
        (Open(dimension=2, settings={"x": b"\0" * 70000}), "RESOURCE_EXHAUSTED.BYTES"),
        (Open(dimension=2, settings={"x": list(range(257))}), "RESOURCE_EXHAUSTED.BYTES"),
        (Open(dimension=2, settings={"x": 2**63}), "INVALID_ARGUMENT.HEADER"),
        (Open(dimension=2, settings={"x": "\ud800"}), "INVALID_ARGUMENT.HEADER"),
    ],
)
def test_wrong_messages_are_not_encoded(message, code):
    with pytest.raises(ProtocolError) as caught:
        encode(message)
    assert caught.value.code == code


def test_no_frames():
    with pytest.raises(ProtocolError, match="at least one frame, got none"):
        decode([])


@pytest.mark.parametrize(
    ("wrong", "request_id"),
    [
        ({"type": "PUNG"}, (b"i" * 16, 9)),
        ({"type": "PUNG", "sequence": 2**63 - 1}, (b"i" * 16, 2**63 - 1)),
        ({"client": b"short", "sequence": -1}, (b"\0" * 16, 0)),
        ({"client": "text of 16 bytes"}, (b"\0" * 16, 9)),
        ({"client": None, "sequence": 2**63}, (b"\0" * 16, 0)),
        ({"client": b"long" * 5, "sequence": "9"}, (b"\0" * 16, 0)),
        ({"sequence": True}, (b"i" * 16, 0)),
    ],
)
def test_an_error_carries_the_request_id_where_it_was_readable(wrong, request_id):
    header = msgpack.unpackb(encode(Ping(client=b"i" * 16, sequence=9))[0])
    with pytest.raises(ProtocolError) as caught:
        decode([msgpack.packb(header | wrong)])
    assert (caught.value.client, caught.value.sequence) == request_id


@pytest.mark.parametrize(
    ("change", "code", "details"),
    [
        (lambda header: header.pop("type"), "HEADER", {"field": "type"}),
        (lambda header: header.update(zebra=1), "HEADER", {"field": "zebra"}),
        (lambda header: header["arrays"].append(dict(header["arrays"][0])), "HEADER", {"field": "arrays"}),
        (lambda header: header["arrays"].clear(), "HEADER", {"field": "displacement"}),
        (lambda header: header["arrays"][0].update(shape=[2**48, 2]), "SHAPE", None),
        (lambda header: header["arrays"][0].update(shape=[float("nan"), 2]), "NONFINITE", None),
    ],
)
def test_an_error_in_the_header_names_the_field(change, code, details):
    first, *others = encode(Move(**AT, frame="committed", step=1, displacement=np.zeros((2, 2))))
    header = msgpack.unpackb(first)
    change(header)
    with pytest.raises(ProtocolError) as caught:
        decode([msgpack.packb(header), *others])
    assert caught.value.code == f"INVALID_ARGUMENT.{code}"
    assert details in (None, caught.value.details)

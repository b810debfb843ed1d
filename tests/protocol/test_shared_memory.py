"""Arrays in memory shared with the receiver of a reply: the same values, no frames, and nothing else is changed."""

import os
import struct
from tempfile import NamedTemporaryFile

import msgpack
import numpy as np
import pytest
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import Moved
from mesh_motion_protocol.shared_memory import SUPPORTED, SharedMemory

pytestmark = pytest.mark.skipif(not SUPPORTED, reason="needs anonymous files of Linux")
ROWS = np.random.default_rng(3).normal(size=(70_001, 2))


def moved(rows=ROWS):
    fields = {"step": 1, "iteration": 1, "quality": {}, "correction": {}, "caches": {}, "seconds": {}, "warnings": []}
    return Moved(client=b"c" * 16, sequence=7, **fields, displacement=rows, enrichment_points=np.zeros((1, 2)))


def content(memory):
    return os.pread(memory.offer["descriptor"], 1 << 24, 0)


def test_a_large_array_has_no_frames_and_the_same_values():
    memory = SharedMemory(ROWS.nbytes)
    frames = encode(moved(), memory.offer)
    assert len(frames) == 2  # the header, the small array
    found = decode(frames, memory=memory)
    assert found.displacement.tobytes() == ROWS.tobytes()
    assert found.displacement.flags.aligned
    assert found.enrichment_points.shape == (1, 2)


def test_a_small_array_and_one_that_does_not_fit_have_frames():
    memory = SharedMemory(ROWS.nbytes)
    before = content(memory)
    for rows in (ROWS[:100], np.concatenate([ROWS, ROWS])):
        assert len(encode(moved(rows), memory.offer)) == 3
        assert content(memory) == before


def test_memory_that_could_be_cut_off_is_left_alone():
    """A signal ends a process that reads a mapped file after another process has made it smaller."""
    unsealed = os.memfd_create("unsealed")
    os.pwrite(unsealed, b"k" * 16 + bytes(2 * ROWS.nbytes), 0)
    assert len(encode(moved(), {"process": os.getpid(), "descriptor": unsealed, "key": b"k" * 16})) == 3
    os.close(unsealed)
    memory = SharedMemory(ROWS.nbytes)
    with pytest.raises(PermissionError):
        os.ftruncate(memory.offer["descriptor"], 0)


def test_a_sender_takes_no_more_of_it_than_it_needs():
    memory = SharedMemory(ROWS.nbytes)
    os.ftruncate(memory.offer["descriptor"], 1 << 40)  # larger than any machine's
    assert len(encode(moved(), memory.offer)) == 2
    assert 512 * os.fstat(memory.offer["descriptor"]).st_blocks < 2 * ROWS.nbytes


def test_memory_is_free_when_no_array_lies_in_it():
    memory = SharedMemory(ROWS.nbytes)
    row = decode(encode(moved(), memory.offer), memory=memory).displacement[5]
    assert not memory.holds(ROWS.nbytes)
    assert row.tobytes() == ROWS[5].tobytes()
    del row
    assert memory.holds(ROWS.nbytes)
    assert not memory.holds(2 * ROWS.nbytes)


def test_an_array_outlives_the_memory():
    memory = SharedMemory(ROWS.nbytes)
    rows = decode(encode(moved(), memory.offer), memory=memory).displacement
    del memory
    assert rows.tobytes() == ROWS.tobytes()


def test_a_descriptor_is_given_back():
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(20):
        SharedMemory(1 << 20)
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize(
    "change",
    [
        {"key": b"k" * 16},
        {"key": b""},
        {"key": "text"},
        {"process": 2**62},
        {"process": "self"},
        {"process": True},
        {"descriptor": -1},
        {"descriptor": 2**40},
        {"descriptor": [1]},
        {"process": None},
    ],
)
def test_a_wrong_offer_of_memory_is_not_used(change):
    memory = SharedMemory(ROWS.nbytes)
    before = content(memory)
    assert len(encode(moved(), memory.offer | change)) == 3
    assert content(memory) == before


@pytest.mark.parametrize("folder", ["/var/tmp", "/dev/shm"])
def test_no_other_file_is_written_to(folder):
    """A file on a disk or in a memory folder that begins with the key, and a descriptor that is not a file's."""
    key = b"k" * 16
    reader, writer = os.pipe()
    with NamedTemporaryFile(dir=folder) as file:
        file.write(key + bytes(2 * ROWS.nbytes))
        file.flush()
        for descriptor in (file.fileno(), reader, writer):
            offer = {"process": os.getpid(), "descriptor": descriptor, "key": key}
            assert len(encode(moved(), offer)) == 3
        file.seek(0)
        assert file.read() == key + bytes(2 * ROWS.nbytes)
    os.close(reader)
    os.close(writer)


def _with_place(at, **declared):
    header = msgpack.unpackb(encode(moved())[0])
    header["arrays"][0] |= {"at": at} | declared
    return [msgpack.packb(header), struct.pack("<2d", 0, 0)]


@pytest.mark.parametrize("at", [0, 8, 65, -64, 2**40, 320, None, True, 64.0, "64"])
def test_a_place_outside_of_the_memory_is_refused(at):
    memory = SharedMemory(ROWS.nbytes)
    with pytest.raises(ProtocolError) as caught:
        decode(_with_place(at), memory=memory)
    assert caught.value.code == "INVALID_ARGUMENT.HEADER"


def test_places_of_narrow_or_empty_arrays_are_refused():
    for declared in ({"dtype": "<f4"}, {"shape": [0, 2]}):
        with pytest.raises(ProtocolError) as caught:
            decode(_with_place(64, **declared), memory=SharedMemory(ROWS.nbytes))
        assert caught.value.code == "INVALID_ARGUMENT.HEADER"


def test_a_place_is_refused_where_no_memory_was_offered():
    with pytest.raises(ProtocolError) as caught:
        decode(_with_place(64))
    assert caught.value.code == "INVALID_ARGUMENT.HEADER"

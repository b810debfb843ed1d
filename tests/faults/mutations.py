"""Messages gone wrong: the golden vectors with bytes, header values and array frames changed, by a seeded generator."""

from collections.abc import Callable
from random import Random
from typing import Any

import msgpack
from mesh_motion_protocol.vectors import load

Frames = list[bytes]

#: What a header's value is replaced by: the edges of each type, and what msgpack leaves open.
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2**31, 2**53, 2**63 - 1, 2**64 - 1, -(2**63), 0.0, -0.0, 1e308, 5e-324,
    float("nan"), float("inf"), "", "a", "\0", "é" * 300, "x" * 5000, b"", b"\xff" * 16, b"c" * 16, b"\0" * 70_000,
    [], {}, [[]], [None] * 257, {"": ""}, [{}] * 256, {str(k): k for k in range(257)}, msgpack.Timestamp(1, 2),
    msgpack.ExtType(5, b"x"), "<f8", "<i8", "<f4", ">f8", "O", "S2147483647", "MOVE", "ERROR", "HELLO",
)  # fmt: skip
#: Keys that no schema has; one that an answer could not repeat.
_KEYS: tuple[Any, ...] = ("", "v", "extra", "__class__", "dtype", "fields", "shape", 7, b"v", "k" * 40_000)
#: Header bytes that no packer writes: types of msgpack at their largest lengths, invalid UTF-8, a key twice.
_RAW: tuple[bytes, ...] = (
    b"\xdf\xff\xff\xff\xff", b"\xdd\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\xc1",
    b"\xc9\x7f\xff\xff\xff\x01", b"\xa2\xff\xfe", b"\x82\xa1a\x01\xa1a\x02", b"\x81\x01\x02", b"\x91" * 600,
    b"\x81\xa1a" * 600, b"\xd6\xff\0\0\0\0", b"\xde\xff\xff", b"\xdc\xff\xff", b"\xc0", b"\x90",
)  # fmt: skip


def golden_frames() -> list[Frames]:
    """The frames of every valid golden vector."""
    return [[bytes.fromhex(frame) for frame in case["frames"]] for case in load("valid")]


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Keys and indices that lead to each value inside a header, itself apart."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = []
    for key, item in items:
        found += [(*path, key), *_places(item, (*path, key))]
    return found


def _header(frames: Frames, change: Callable[[Any, Any], None], random: Random) -> Frames:
    """Change what is at a random place of the header, as long as it can be read."""
    try:
        header = msgpack.unpackb(frames[0], strict_map_key=False)
        places = _places(header)
        if not places:
            return frames
        *way, last = random.choice(places)
        inner = header
        for key in way:
            inner = inner[key]
        change(inner, last)
        return [msgpack.packb(header), *frames[1:]]
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException):
        return frames


def _replace(frames: Frames, random: Random) -> Frames:
    """Another value at some place."""
    return _header(frames, lambda inner, key: inner.__setitem__(key, random.choice(_VALUES)), random)


def _nudge(frames: Frames, random: Random) -> Frames:
    """A number off by a little or a lot; anything else twice as long."""

    def change(inner: Any, key: Any) -> None:
        value = inner[key]
        if isinstance(value, (int, float)):
            inner[key] = value + random.choice((-1, 1, 0.5, 255, 2**32, -(2**40)))
        elif isinstance(value, (str, bytes, list)):
            inner[key] = random.choice((value * 2, value[:-1], value[::-1]))

    return _header(frames, change, random)


def _remove(frames: Frames, random: Random) -> Frames:
    """A key or an item is missing."""
    return _header(frames, lambda inner, key: inner.pop(key), random)


def _add(frames: Frames, random: Random) -> Frames:
    """An unknown key, or one more item."""

    def change(inner: Any, key: Any) -> None:
        if isinstance(inner, dict):
            inner[random.choice(_KEYS)] = random.choice(_VALUES)
        else:
            inner.append(inner[key])

    return _header(frames, change, random)


def _rename(frames: Frames, random: Random) -> Frames:
    """A key under another name."""

    def change(inner: Any, key: Any) -> None:
        if isinstance(inner, dict):
            inner[random.choice((*_KEYS, str(key).upper()))] = inner.pop(key)

    return _header(frames, change, random)


def _bits(frames: Frames, random: Random) -> Frames:
    """Some bits of some frame turned."""
    at = random.randrange(len(frames)) if random.random() < 0.3 else 0
    data = bytearray(frames[at])
    for _ in range(random.randrange(1, 6) if data else 0):
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    return [*frames[:at], bytes(data), *frames[at + 1 :]]


def _splice(frames: Frames, random: Random) -> Frames:
    """Bytes of the header left out, doubled, or replaced by what no packer writes."""
    data = frames[0]
    start = random.randrange(len(data) + 1)
    end = min(len(data), start + random.randrange(16))
    middle = random.choice((b"", data[start:end] * 2, random.choice(_RAW), random.randbytes(8)))
    return [data[:start] + middle + data[end:], *frames[1:]]


def _noise(frames: Frames, random: Random) -> Frames:
    """Something else altogether in frame 0."""
    return [random.choice((random.randbytes(random.randrange(64)), random.choice(_RAW))), *frames[1:]]


def _cut(frames: Frames, random: Random) -> Frames:
    """A frame ends early, or goes on."""
    at = random.randrange(len(frames))
    data = frames[at]
    data = data[: random.randrange(len(data) + 1)] if random.random() < 0.5 else data + random.randbytes(8)
    return [*frames[:at], data, *frames[at + 1 :]]


def _frames(frames: Frames, random: Random) -> Frames:
    """Frames missing, doubled, empty, in another order, or none at all."""
    changed = list(frames)
    what = random.randrange(5)
    if what == 0:
        changed.pop(random.randrange(len(changed)))
    elif what == 1:
        changed.insert(random.randrange(len(changed) + 1), random.choice(changed))
    elif what == 2:
        changed[random.randrange(len(changed))] = b""
    elif what == 3:
        random.shuffle(changed)
    else:
        changed += [b"\0" * random.choice((1, 8, 16, 4096))] * random.randrange(1, 4)
    return changed


#: By name; each takes frames (one at least) and a generator.
MUTATIONS: dict[str, Callable[[Frames, Random], Frames]] = {
    "replace": _replace,
    "nudge": _nudge,
    "remove": _remove,
    "add": _add,
    "rename": _rename,
    "bits": _bits,
    "splice": _splice,
    "noise": _noise,
    "cut": _cut,
    "frames": _frames,
}
_WEIGHTS = (6, 6, 3, 3, 2, 5, 4, 1, 2, 3)


def mutated(frames: Frames, random: Random) -> Frames:
    """One to three changes, one after the other."""
    for change in random.choices(tuple(MUTATIONS.values()), _WEIGHTS, k=random.choice((1, 1, 2, 3))):
        if frames:
            frames = change(frames, random)
    return frames

"""Mutated messages from a seeded generator: values of the header, declared arrays, numbers, frames, bytes.

The decoder's fuzz starts from the golden vectors, the handlers' fuzz from valid requests of a session: most mutants can
still be decoded, and reach the handlers.
"""

import struct
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from random import Random
from typing import Any

import msgpack
from mesh_motion_protocol.vectors import load

Frames = list[bytes]

#: Replacements of a value: the edges of each type, words of the protocol, and values that msgpack leaves open.
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, 2, 3, 5, -1, 255, 256, 2**31, 2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1, -(2**63),
    0.0, -0.0, 0.5, 5e-324, 1e12, 1e300, -1e308, float("nan"), float("inf"), "", "a", "\0", "a\0b", "\ud800", "\r\n",
    "é" * 128, "é" * 300, "x" * 256, "x" * 65_000, "../../etc/passwd", "%s%n", "0" * 32, "f" * 32, "F" * 32,
    "committed", "reference", "keep", "discard", "nodes", "cells", "patch", "global_ids", "triangle", "quad", "left",
    "moving", "fixed", "slip", "periodic", "full", "relaxed", "replay", "MOVE", "ERROR", "HELLO",
    b"", b"\0" * 16, b"\0" * 32, b"t" * 32, b"\xff" * 33, b"\0" * 70_000, [], {}, [[]], [[1, 0]], [[1, 2**63]],
    [None] * 257, ["a"] * 300, {"": None}, [{}] * 256, {str(k): k for k in range(257)}, [[[[[[[[[[{"a": [1]}]]]]]]]]]],
    {"support_radius": -1.0}, {"basis": 1}, {"nonsense": []}, msgpack.Timestamp(1, 2), msgpack.ExtType(5, b"x"),
)  # fmt: skip
#: Keys that no schema has, or another place; one that an answer could not repeat.
_KEYS: tuple[Any, ...] = (
    "", "v", "extra", "__class__", "dtype", "fields", "shape", "session", "token", "step", "settings", "label", 7, b"v",
    "k" * 40_000,
)  # fmt: skip
#: Header bytes that no packer writes: types of msgpack at their largest lengths, invalid UTF-8, a key twice.
_RAW: tuple[bytes, ...] = (
    b"\xdf\xff\xff\xff\xff", b"\xdd\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\xc1",
    b"\xc9\x7f\xff\xff\xff\x01", b"\xa2\xff\xfe", b"\x82\xa1a\x01\xa1a\x02", b"\x81\x01\x02", b"\x91" * 600,
    b"\x81\xa1a" * 600, b"\xd6\xff\0\0\0\0", b"\xde\xff\xff", b"\xdc\xff\xff", b"\xc0", b"\x90",
)  # fmt: skip
_DTYPES = ("<f8", "<f4", "<i8", "<i4", ">f8", "O", "<u8", "S2147483647", "V100", "")
_SHAPES: tuple[list[Any], ...] = (
    [], [0, 2], [1, 1], [2, 2], [2**40, 2**40], [-1, 2], [0, 2**62], ["a", 1], [1.5, 2],
)  # fmt: skip
_DOUBLES = (*(float("nan"), float("inf"), -float("inf")) * 2, 1e300, -1e300, 5e-324, 1e13, 1e11, 0.0, -0.0, 3.0, -1.0)
_INTEGERS = (-1, 0, 1, 99, 2**31, 2**40, 2**63 - 1, -(2**63))
#: A change strikes so often inside the fields, and else anywhere in the header.
_IN_FIELDS = 0.85


@dataclass
class Draft:
    """A message before packing: its header and the frames after it."""

    header: Any
    frames: Frames

    @classmethod
    def of(cls, frames: Any) -> "Draft":
        header, *rest = (bytes(frame) for frame in frames)
        return cls(msgpack.unpackb(header), rest)

    def packed(self) -> Frames:
        return [msgpack.packb(self.header, unicode_errors="surrogatepass"), *self.frames]


def golden_frames() -> list[Frames]:
    return [[bytes.fromhex(frame) for frame in case["frames"]] for case in load("valid")]


# --- of a value in the header: what holds it, its key there ----------------------------------------------------------


def _replace(inner: Any, key: Any, random: Random) -> None:
    alike = [value for value in VALUES if type(value) is type(inner[key])]
    inner[key] = deepcopy(random.choice(alike if alike and random.random() < 0.6 else VALUES))


def _nudge(inner: Any, key: Any, random: Random) -> None:
    """A number changed by a little or a lot; other values longer, shorter or reversed."""
    value = inner[key]
    if isinstance(value, (int, float)):
        moved = value + random.choice((-1, 1, 0.5, 255, 2**32, -(2**40)))
        inner[key] = moved if isinstance(moved, float) else min(max(moved, -(2**63)), 2**64 - 1)
    elif isinstance(value, (str, bytes, list)):
        inner[key] = random.choice((value * 2, value[:-1], value[::-1]))


def _remove(inner: Any, key: Any, _random: Random) -> None:
    inner.pop(key)


def _add(inner: Any, key: Any, random: Random) -> None:
    if isinstance(inner, dict):
        inner[random.choice(_KEYS)] = deepcopy(random.choice(VALUES))
    else:
        inner.append(inner[key])


def _rename(inner: Any, key: Any, random: Random) -> None:
    if isinstance(inner, dict):
        inner[random.choice((*_KEYS, str(key).upper()))] = inner.pop(key)


def _places(value: Any) -> list[tuple[Any, Any]]:
    """The container and the key of each nested value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, item in items for place in ((value, key), *_places(item))]


def _somewhere(change: Callable[[Any, Any, Random], None]) -> "Change":
    def changed(draft: Draft, random: Random) -> None:
        root = draft.header.get("fields") if random.random() < _IN_FIELDS else None
        places = _places(root) or _places(draft.header)
        if places:
            change(*random.choice(places), random)

    return changed


# --- of arrays and frames --------------------------------------------------------------------------------------------


def _reshaped(draft: Draft, random: Random) -> None:
    """Another shape or dtype, with a frame that fits it or does not."""
    declared = draft.header.get("arrays")
    for array in declared if isinstance(declared, list) else ():
        if not (isinstance(array, dict) and isinstance(shape := array.get("shape"), list)):
            continue
        what = random.randrange(5)
        if what == 0:
            array["shape"] = list(random.choice((*_SHAPES, shape[::-1], [*shape, 1], shape[:1])))
        elif what == 1:
            array["dtype"] = random.choice(_DTYPES)
        elif what == 2 and draft.frames:
            array["dtype"] = "<f4" if array.get("dtype") == "<f8" else "<i4"
            draft.frames[0] = draft.frames[0][: len(draft.frames[0]) // 2]
        elif what == 3:
            array["name"] = random.choice(("rows", "displacement", "points", ""))
        else:
            rows, columns = random.randrange(4), random.choice((0, 1, 2, 3, 4, 8))
            array["shape"] = [rows, columns]
            draft.frames[:1] = [bytes(8 * rows * columns)] if rows * columns else []


def _numbers(draft: Draft, random: Random) -> None:
    """Change numbers inside an array: not finite, huge, tiny, or invalid indices."""
    for at in range(min(1, len(draft.frames))):
        frame = bytearray(draft.frames[at])
        for _ in range(random.choice((1, 1, 3)) if len(frame) >= 8 else 0):
            place, real = 8 * random.randrange(len(frame) // 8), random.random() < 0.6
            number = struct.pack("<d", random.choice(_DOUBLES)) if real else struct.pack("<q", random.choice(_INTEGERS))
            frame[place : place + 8] = number
        draft.frames[at] = bytes(frame)


def _frames(draft: Draft, random: Random) -> None:
    """Frames missing, repeated, empty, cut, in another order, or too many."""
    frames, what = draft.frames, random.randrange(5)
    if what == 0 or not frames:
        frames += [b"\0" * random.choice((0, 1, 8, 4096))] * random.randrange(1, 4)
    elif what == 1:
        frames.pop(random.randrange(len(frames)))
    elif what == 2:
        frames.insert(random.randrange(len(frames) + 1), random.choice(frames))
    elif what == 3:
        at = random.randrange(len(frames))
        frames[at] = frames[at][: random.randrange(len(frames[at]) + 1)]
    else:
        frames[0] = b""
        random.shuffle(frames)


# --- of bytes --------------------------------------------------------------------------------------------------------


def _bits(data: bytes, random: Random) -> bytes:
    turned = bytearray(data)
    for _ in range(random.randrange(1, 6)):
        turned[random.randrange(len(turned))] ^= 1 << random.randrange(8)
    return bytes(turned)


def _splice(data: bytes, random: Random) -> bytes:
    """Remove or repeat bytes, replace them by bytes that no packer writes, or cut the end."""
    start = random.randrange(len(data) + 1)
    end = random.choice((len(data), *(min(len(data), start + random.randrange(16)) for _ in range(4))))
    middle = random.choice((b"", data[start:end] * 2, random.choice(_RAW), random.randbytes(8)))
    return data[:start] + middle + data[end:]


def _noise(_data: bytes, random: Random) -> bytes:
    """Something else altogether."""
    return random.choice((random.randbytes(random.randrange(64)), random.choice(_RAW)))


Change = Callable[[Draft, Random], None]
#: The changes of a message, and how often each is drawn.
CHANGES: Mapping[Change, int] = {
    _somewhere(_replace): 8, _somewhere(_nudge): 4, _somewhere(_remove): 2, _somewhere(_add): 1, _somewhere(_rename): 1,
    _reshaped: 5, _numbers: 8, _frames: 3,
}  # fmt: skip


def gone_wrong(draft: Draft, random: Random, changes: Mapping[Change, int] = CHANGES, raw: float = 0.4) -> Frames:
    """Apply zero to three changes one after the other and pack the draft; change bytes with the probability ``raw``."""
    for change in random.choices(list(changes), list(changes.values()), k=random.choice((0, 1, 1, 1, 2, 3))):
        change(draft, random)
    head, *frames = draft.packed()
    if random.random() < raw:
        (change_bytes,) = random.choices((_bits, _splice, _noise), (5, 4, 1))
        head = change_bytes(head, random)
    return [head, *frames]

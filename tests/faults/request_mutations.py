"""Valid requests gone wrong in their meaning: fields, addresses, numbers, arrays. Most still can be decoded.

Where :mod:`.mutations` breaks the frames of golden vectors for the decoder, these reach the handlers.
"""

import struct
from collections.abc import Callable
from random import Random
from typing import Any

import msgpack

from tests.faults.mutations import mutated
from tests.faults.valid_requests import Known, Request

_INTEGERS = (0, 1, 2, -1, 3, 5, 255, 256, 2**31, 2**53, 2**62, 2**63 - 1, 2**63, -(2**63), 2**64 - 1)
_FLOATS = (0.0, -0.0, 0.5, 1e-320, 1e12, 1e300, -1e308, float("nan"), float("inf"))
_TEXTS = (
    "", "a", "\0", "committed", "reference", "keep", "discard", "nodes", "cells", "patch", "global_ids", "triangle",
    "quad", "left", "right", "moving", "fixed", "slip", "symmetry", "periodic", "full", "relaxed", "replay", "x" * 256,
    "é" * 128, "é" * 200, "x" * 65_000, "a\0b", "\ud800", "../../etc/passwd", "0" * 32, "f" * 32, "F" * 32,
    "%s%n", "\r\n",
)  # fmt: skip
_BYTES = (b"", b"\0" * 16, b"\0" * 32, b"t" * 32, b"\xff" * 31, b"\xff" * 33, b"x" * 65_000)
_CONTAINERS: tuple[Any, ...] = (
    None,
    True,
    False,
    [],
    {},
    [[1, 0]],
    [[2, 0]],
    [[]],
    [[1, 2**63]],
    ["a"] * 300,
    {"": None},
)
_DTYPES = ("<f8", "<f4", "<i8", "<i4", ">f8", "O", "<u8", "S8", "V100", "")
_SHAPES: tuple[list[Any], ...] = (
    [], [0, 2], [1, 1], [2, 2], [2**40, 2**40], [-1, 2], [0, 2**62], ["a", 1], [1.5, 2],
)  # fmt: skip
_ROLES = ("", "moving", "fixed", "slip", "symmetry", "periodic")
_DOUBLES = (float("nan"), float("inf"), 1e300, -1e300, 5e-324, 1e13, 1e11, 0.0, -0.0, 3.0, -1.0, 0.25)
_SETTINGS = ("basis", "support_radius", "quality_threshold", "max_enrichment_points", "sub_steps", "nonsense", "",
             "correction", "reduction", "displacement")  # fmt: skip
_FIELDS = ("session", "epoch", "partition", "token", "step", "frame", "item", "name", "role", "what", "outcome",
           "label", "dimension", "partitions", "settings", "versions", "agent", "after", "extra", "")  # fmt: skip


def _deep(levels: int) -> Any:
    value: Any = 1
    for level in range(levels):
        value = [value] if level % 2 else {"a": value}
    return value


def _anything(random: Random) -> Any:
    """A value of any type."""
    kind = random.randrange(8)
    if kind < 3:
        return random.choice((_INTEGERS, _FLOATS, _TEXTS)[kind])
    if kind == 3:
        return random.choice(_BYTES)
    if kind == 4:
        return _deep(random.choice((1, 5, 9, 10, 11, 12, 40)))
    if kind == 5:
        return random.choice(_CONTAINERS)
    if kind == 6:
        return {random.choice(_SETTINGS): random.choice((*_INTEGERS[:6], *_FLOATS, *_TEXTS[:20], None, True, [], {}))}
    return random.getrandbits(random.choice((1, 8, 31, 63)))


def _another_value(request: Request, _known: Known, random: Random) -> None:
    """A field with a value of its own type that is unusual, or of any type."""
    fields = request.header["fields"]
    if not fields:
        return
    name = random.choice(list(fields))
    was = fields[name]
    if random.random() < 0.4:
        fields[name] = _anything(random)
    elif isinstance(was, str):
        fields[name] = random.choice(_TEXTS)
    elif isinstance(was, bytes):
        fields[name] = random.choice(_BYTES)
    elif isinstance(was, int):
        fields[name] = random.choice((*_INTEGERS, was + 1, was - 1))
    else:
        fields[name] = _anything(random)


def _a_setting(request: Request, _known: Known, random: Random) -> None:
    """OPEN's settings."""
    if request.kind == "OPEN":
        value = random.choice((*_INTEGERS, *_FLOATS, *_TEXTS, None, True, [1], {"a": 1}))
        request.header["fields"]["settings"] = {random.choice(_SETTINGS): value}


def _missing(request: Request, _known: Known, random: Random) -> None:
    fields = request.header["fields"]
    if fields:
        fields.pop(random.choice(list(fields)))


def _extra(request: Request, _known: Known, random: Random) -> None:
    request.header["fields"][random.choice(_FIELDS)] = _anything(random)


def _address(request: Request, known: Known, random: Random) -> None:
    """Another session, epoch, partition, step or token that could be right."""
    fields = request.header["fields"]
    name = random.choice(("session", "epoch", "partition", "step", "token"))
    if name in fields:
        fields[name] = {
            "session": random.choice(("f" * 32, known.session.upper(), known.session[:-1], known.session + " ")),
            "epoch": random.choice((known.epoch - 1, known.epoch + 1, 0)),
            "partition": random.choice((known.partitions, 255, 0, 1)),
            "step": random.choice((known.step, known.step + 2, 0, 2**62)),
            "token": known.token[:-1] + b"\0",
        }[name]


def _repeated(request: Request, known: Known, random: Random) -> None:
    """A request id that was used before, or will be, or another client's."""
    header = request.header
    header["sequence"] = max(1, known.sequence - random.randrange(12))
    if random.random() < 0.2:
        header["sequence"] = random.choice(_INTEGERS)
    if random.random() < 0.3:
        header["client"] = bytes([random.randrange(5)]) * random.choice((16, 16, 16, 15, 0))


def _rows(request: Request, _known: Known, random: Random) -> None:
    """Numbers inside an array: not finite, huge, tiny, or indices that are none."""
    if not request.frames:
        return
    frame = bytearray(request.frames[0])
    for _ in range(random.choice((1, 1, 3))):
        if len(frame) >= 8:
            at = 8 * random.randrange(len(frame) // 8)
            value = struct.pack("<d", random.choice(_DOUBLES)) if random.random() < 0.6 else struct.pack(
                "<q", random.choice((-1, 0, 1, 99, 2**31, 2**40, 2**63 - 1, -(2**63)))
            )  # fmt: skip
            frame[at : at + 8] = value
    request.frames[0] = bytes(frame)


def _reshaped(request: Request, _known: Known, random: Random) -> None:
    """Another shape or dtype with a frame that fits it, or does not."""
    for declared in request.header["arrays"]:
        if not (isinstance(declared, dict) and isinstance(shape := declared.get("shape"), list)):
            continue
        what = random.randrange(5)
        if what == 0:
            declared["shape"] = random.choice((*_SHAPES, shape[::-1], [*shape, 1], shape[:1]))
        elif what == 1:
            declared["dtype"] = random.choice(_DTYPES)
        elif what == 2 and request.frames:
            declared["dtype"] = "<f4" if declared.get("dtype") == "<f8" else "<i4"
            request.frames[0] = request.frames[0][: len(request.frames[0]) // 2]
        elif what == 3:
            declared["name"] = random.choice(("rows", "displacement", "points", ""))
        else:
            rows, columns = random.randrange(4), random.choice((0, 1, 2, 3, 4, 8))
            declared["shape"] = [rows, columns]
            request.frames[:1] = [bytes(8 * rows * columns)] if rows * columns else []


def _frames(request: Request, _known: Known, random: Random) -> None:
    """Frames too many, too few, swapped, cut."""
    frames, what = request.frames, random.randrange(4)
    if what == 0:
        frames.append(b"\0" * random.choice((0, 8, 4096)))
    elif what == 1 and frames:
        frames.pop()
    elif what == 2 and frames:
        frames[0] = frames[0][:-1]
    else:
        frames.reverse()


def _upload_words(request: Request, _known: Known, random: Random) -> None:
    """Item, name and role that do not go together."""
    if request.kind == "UPLOAD":
        request.header["fields"] |= {
            "item": random.choice(("nodes", "global_ids", "cells", "facets", "near_cells", "patch")),
            "name": random.choice(("", "triangle", "quad", "tetra", "line", "left", "x" * 256, "\0")),
            "role": random.choice(_ROLES),
        }


def _header(request: Request, _known: Known, random: Random) -> None:
    """A key of the header itself."""
    key = random.choice(("v", "type", "client", "sequence", "fields", "arrays", "more"))
    if random.random() < 0.2:
        request.header.pop(key, None)
        request.header.setdefault("type", "")
    else:
        request.header[key] = _anything(random)


_Mutation = Callable[[Request, Known, Random], None]
#: By name; those that reach the handlers come more often.
REQUEST_MUTATIONS: dict[str, tuple[_Mutation, int]] = {
    "another value": (_another_value, 8),
    "a setting": (_a_setting, 2),
    "missing": (_missing, 3),
    "extra": (_extra, 2),
    "address": (_address, 5),
    "repeated": (_repeated, 5),
    "rows": (_rows, 6),
    "reshaped": (_reshaped, 5),
    "frames": (_frames, 2),
    "upload words": (_upload_words, 3),
    "header": (_header, 1),
}
_CHANGES = tuple(change for change, _ in REQUEST_MUTATIONS.values())
_WEIGHTS = tuple(weight for _, weight in REQUEST_MUTATIONS.values())


def gone_wrong(request: Request, known: Known, random: Random) -> None:
    """No change to three, one after the other."""
    for change in random.choices(_CHANGES, _WEIGHTS, k=random.choice((0, 1, 1, 1, 2, 3))):
        if isinstance(request.header.get("fields"), dict) and isinstance(request.header.get("arrays"), list):
            change(request, known, random)


def frames_of(request: Request, random: Random) -> list[bytes]:
    """On the wire, as far as it can be packed; now and then with what no packer would write."""
    try:
        head = msgpack.packb(request.header, unicode_errors="surrogatepass")
    except (OverflowError, ValueError, TypeError):
        head = msgpack.packb({**request.header, "fields": {}, "sequence": 1, "client": bytes(16)}, default=str)
    frames = [head, *request.frames]
    return mutated(frames, random) if random.random() < 0.03 else frames

"""Attacks on a server's sockets below ZeroMQ: bytes that a peer may send, but libzmq never sends.

Each function makes its attack and returns what the server accepted; it does not judge. A caller compares the server
before and after: its processes, memory, open files, and whether it answers. ``count`` is the number of attacks; the
same ``seed`` makes the same bytes.

Addresses are ``tcp://HOST:PORT`` or ``ipc:///path``. ZMTP 3 is ZeroMQ RFC 23, its CURVE mechanism RFC 25.
"""

import contextlib
import random
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator

_SECONDS = 30.0
_FLAG_MORE, _FLAG_LONG, _FLAG_COMMAND = 1, 2, 4


def ended(raw: socket.socket) -> bool:
    """Whether the other end closes the connection, within the socket's timeout."""
    try:
        while raw.recv(256):
            pass
    except ConnectionError:
        pass
    except TimeoutError:
        return False
    return True


def connection(endpoint: str) -> socket.socket:
    if endpoint.startswith("ipc://"):
        raw = socket.socket(socket.AF_UNIX)
        raw.settimeout(_SECONDS)
        raw.connect(endpoint.removeprefix("ipc://"))
        return raw
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    return socket.create_connection((host.strip("[]"), int(port)), timeout=_SECONDS)


def greeting(mechanism: bytes) -> bytes:
    """The 64 bytes that open a ZMTP 3.0 connection."""
    return b"\xff" + bytes(8) + b"\x7f\x03\x00" + mechanism.ljust(20, b"\0") + bytes(32)


def command(name: bytes, body: bytes) -> bytes:
    """A command frame: HELLO, READY, …"""
    content = bytes([len(name)]) + name + body
    if len(content) < 256:
        return bytes([_FLAG_COMMAND, len(content)]) + content
    return bytes([_FLAG_COMMAND | _FLAG_LONG]) + struct.pack(">Q", len(content)) + content


def ready(**properties: bytes) -> bytes:
    """The READY command of the NULL mechanism, for a DEALER with these additional properties."""
    values = {"Socket-Type": b"DEALER"} | {name.replace("_", "-"): value for name, value in properties.items()}
    body = b"".join(
        bytes([len(name)]) + name.encode() + struct.pack(">I", len(value)) + value for name, value in values.items()
    )
    return command(b"READY", body)


def endless_message(endpoint: str, frame_bytes: int, most_bytes: int) -> int:
    """Send frames with MORE set until the server closes the connection: MAXMSGSIZE and the high-water mark do not limit
    them.

    Returns the number of accepted bytes, ``most_bytes`` if the server never closed the connection.
    """
    header = bytes([_FLAG_MORE | _FLAG_LONG]) + struct.pack(">Q", frame_bytes)
    return _pour(endpoint, greeting(b"NULL") + ready(), b"READY", header + bytes(frame_bytes), most_bytes)


def oversized_hello(endpoint: str, size: int) -> int:
    """Send a CURVE HELLO of ``size`` bytes, before any authentication.

    Returns the number of accepted bytes, ``size`` if all were accepted.
    """
    opening = greeting(b"CURVE") + bytes([_FLAG_COMMAND | _FLAG_LONG]) + struct.pack(">Q", size) + b"\x05HELLO"
    return _pour(endpoint, opening, greeting(b"CURVE")[:1], bytes(1 << 20), size)


def _pour(endpoint: str, opening: bytes, answer: bytes, block: bytes, most_bytes: int) -> int:
    """Send an opening, wait until the server's answer contains these bytes, then send the same block again and
    again.
    """
    sent = 0
    with connection(endpoint) as raw:
        raw.sendall(opening)
        with contextlib.suppress(ConnectionError, TimeoutError):
            if answer not in until(raw, answer):
                return sent
            while sent < most_bytes:
                raw.sendall(block)
                sent += len(block)
    return min(sent, most_bytes)


def forged_user(endpoint: str, user: bytes, frame: bytes) -> bytes:
    """Send a request as a peer without keys that names itself a user in the metadata of its READY.

    ``frame``: frame 0 of a request, shorter than 256 bytes. Returns the server's bytes, greeting and READY included;
    empty if the server closed.
    """
    back = b""
    with connection(endpoint) as raw:
        raw.settimeout(1.0)
        raw.sendall(greeting(b"NULL") + ready(User_Id=user))
        with contextlib.suppress(ConnectionError, TimeoutError):
            back += until(raw, b"READY")
            raw.sendall(bytes([0, len(frame)]) + frame)
            while chunk := raw.recv(1 << 16):
                back += chunk
    return back


def until(raw: socket.socket, word: bytes) -> bytes:
    """Read bytes up to a word: a frame that is sent before the server's READY ends the connection."""
    back = b""
    while word not in back and (chunk := raw.recv(256)):
        back += chunk
    return back


@contextlib.contextmanager
def half_open(endpoint: str, *, seed: int, count: int) -> Iterator[list[socket.socket]]:
    """Open connections that stop at different places of the greeting and then keep silent; all stay open."""
    rng = random.Random(seed)
    held: list[socket.socket] = []
    try:
        for _ in range(count):
            opening = greeting(rng.choice((b"NULL", b"CURVE")))
            held.append(connection(endpoint))
            with contextlib.suppress(ConnectionError):
                held[-1].sendall(opening[: rng.randrange(len(opening))])
        yield held
    finally:
        for raw in held:
            raw.close()


def _noise(rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(1, 4096))


def _cut_greeting(rng: random.Random) -> bytes:
    return greeting(rng.choice((b"NULL", b"CURVE", b"PLAIN", b"GSSAPI")))[: rng.randrange(1, 64)]


def _flipped(rng: random.Random) -> bytes:
    data = bytearray(greeting(b"NULL") + ready(Identity=rng.randbytes(rng.randrange(1, 64))))
    for _ in range(rng.randrange(1, 8)):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def _curve_hello(rng: random.Random) -> bytes:
    """A HELLO of the right form: version, padding, a random key, nonce and box."""
    return greeting(b"CURVE") + command(b"HELLO", b"\x01\x00" + bytes(72) + rng.randbytes(120))


def _curve_other(rng: random.Random) -> bytes:
    """Another command than the expected one, with a body of any length."""
    name = rng.choice((b"HELLO", b"INITIATE", b"WELCOME", b"READY", b"MESSAGE", b"ERROR", b""))
    return greeting(b"CURVE") + command(name, rng.randbytes(rng.randrange(600)))


def _huge_announcement(rng: random.Random) -> bytes:
    """A frame with a declared length of up to 2⁶³ bytes, of which few are sent."""
    flags = bytes([_FLAG_LONG | rng.choice((0, _FLAG_MORE, _FLAG_COMMAND))])
    opening = greeting(b"CURVE") if rng.random() < 0.5 else greeting(b"NULL") + ready()
    return opening + flags + struct.pack(">Q", rng.randrange(1 << rng.randrange(8, 63))) + rng.randbytes(64)


def _frames(rng: random.Random) -> bytes:
    """An opened connection, then frames with any flags, lengths and bytes."""
    frames = b"".join(
        bytes([rng.randrange(256), size]) + rng.randbytes(size) for size in (rng.randrange(256) for _ in range(4))
    )
    return greeting(b"NULL") + ready() + frames


def _old_version(rng: random.Random) -> bytes:
    """The openings of ZMTP 1 and 2."""
    return rng.choice((b"\x01\x00", b"\xff" + bytes(8) + b"\x7f\x01\x05\x00\x00")) + rng.randbytes(rng.randrange(64))


#: The messages of each storm, by its name.
STORMS: dict[str, Callable[[random.Random], bytes]] = {
    "noise": _noise,
    "cut greeting": _cut_greeting,
    "flipped bits": _flipped,
    "curve hello": _curve_hello,
    "curve other": _curve_other,
    "huge announcement": _huge_announcement,
    "frames": _frames,
    "old version": _old_version,
}


def storm(endpoint: str, *, seed: int, count: int) -> Counter[str]:
    """Make connections with one fault each, one after the other.

    They end with a reset, so that the kernel keeps no memory of them and 10⁵ connections need no more ports than 100.

    Returns the number of connections by kind; ``"not connected"`` for those that found no listener within a second.
    """
    rng = random.Random(seed)
    made: Counter[str] = Counter()
    for _ in range(count):
        kind = rng.choice(tuple(STORMS))
        data = STORMS[kind](rng)
        try:
            raw = _persistent_connection(endpoint)
        except OSError:
            made["not connected"] += 1
            continue
        with raw:
            with contextlib.suppress(OSError):
                _send(raw, data, patient=rng.random() < 0.2)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        made[kind] += 1
    return made


def _send(raw: socket.socket, data: bytes, *, patient: bool) -> None:
    """Send all parts at once, or each part when the protocol expects it."""
    opening = greeting(b"NULL") + ready()
    if not patient or not data.startswith(opening):
        raw.sendall(data)
        return
    raw.settimeout(0.2)
    raw.sendall(opening)
    until(raw, b"READY")
    raw.sendall(data[len(opening) :])
    raw.recv(256)


def _persistent_connection(endpoint: str) -> socket.socket:
    """Connect; wait while the backlog is full."""
    deadline = time.monotonic() + 1.0
    while True:
        try:
            return connection(endpoint)
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)

"""Bad neighbours of a session; each is a process that repeats its attack and counts.

===========  ========================================================================================================
``upload``   opens a session and uploads 100 MB to it
``crash``    opens a session whose worker is killed, aborts, or reaches its memory limit, in turn
``slow``     a hundred connections that say nothing, ten that send a byte a second, one that stops reading in the middle
             of a reply of 100 MB, and one that asks the control endpoint without ever reading an answer
===========  ========================================================================================================
"""

import socket
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np
from mesh_motion_client import MeshMotionError
from mesh_motion_client.control import Control
from mesh_motion_client.courier import Courier
from mesh_motion_client.credentials import Credentials
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import (
    Close,
    Closed,
    Fetch,
    Hello,
    Join,
    Message,
    Open,
    Opened,
    Status,
    StatusReport,
    Upload,
    Uploaded,
)

from tests.faults.attacks import connection, greeting, ready, until
from tests.faults.check import require
from tests.faults.processes import end_with_parent

_SECONDS = 60.0
#: Rows of three numbers, 8 bytes each, that make 100 MB.
_LARGE_ROWS = 100_000_000 // 24
_PARTS = 4
_SILENT, _SLOW = 100, 10
_ASKED = 5_000
#: How workers end, and the codes that their clients get.
_SEEN_AS = {"kill": "UNAVAILABLE.WORKER", "abort": "UNAVAILABLE.WORKER", "memory": "RESOURCE_EXHAUSTED.MEMORY"}


class Guest:
    """A session, held by a client that knows the protocol."""

    def __init__(self, endpoint: str, label: str) -> None:
        self.control = Control(endpoint)
        self.opened = self.control.ask(Open, Opened, _SECONDS, dimension=3, label=label)
        self.courier = Courier(self.control, Credentials(self.opened.session, self.opened.token), 0)
        self.courier.join(self.opened.endpoint, self.opened.epoch, _SECONDS)

    def close(self) -> None:
        with suppress(MeshMotionError):
            self.courier.deliver(Close(**self.courier.address, outcome="discard"), Closed, _SECONDS)
        self.leave()

    def leave(self) -> None:
        self.courier.disconnect()
        self.control.close()


def upload(endpoint: str) -> None:
    """Upload 100 MB, in parts like the client."""
    guest = Guest(endpoint, "upload")
    rows = np.random.default_rng(1).random((_LARGE_ROWS // _PARTS, 3))
    for _ in range(_PARTS):
        guest.courier.deliver(Upload(**guest.courier.address, item="nodes", rows=rows), Uploaded, _SECONDS)
    guest.close()


def crash(endpoint: str, how: str) -> None:
    """End a worker; its client gets an error, and no other client notices it."""
    guest = Guest(endpoint, how)
    try:
        guest.courier.deliver(Status(**guest.courier.address), StatusReport, _SECONDS)
    except MeshMotionError as error:
        require(error.code == _SEEN_AS[how], f"the worker that was to {how} was answered {error.code}: {error}")
    else:
        require(condition=False, message=f"the worker that was to {how} goes on")
    guest.close()


def slow(endpoint: str) -> None:
    """Hold all slow and silent connections for a while."""
    guest = Guest(endpoint, "slow")
    with ExitStack() as stack:
        for _ in range(_SILENT):
            stack.enter_context(connection(endpoint))
        dripping = [stack.enter_context(connection(endpoint)) for _ in range(_SLOW)]
        stack.enter_context(_stops_reading(guest))
        stack.enter_context(_never_reads(endpoint))
        for byte in greeting(b"NULL")[:2]:
            for raw in dripping:
                with suppress(OSError):
                    raw.sendall(bytes([byte]))
            time.sleep(1.0)
    guest.close()


def _stops_reading(guest: Guest) -> socket.socket:
    """A connection on which 100 MB wait, of which the client has read 1 MB."""
    raw = _spoken(guest.opened.endpoint)
    address: dict[str, Any] = {"session": guest.opened.session, "epoch": guest.opened.epoch, "client": b"r" * 16}
    _say(raw, Join(**address, sequence=1, token=guest.opened.token))
    _say(raw, Fetch(**address, sequence=2))
    read = 0
    while read < 1 << 20:
        chunk = raw.recv(1 << 16)
        require(chunk, "the connection ended before a part of the reply was there")
        read += len(chunk)
    return raw


def _never_reads(endpoint: str) -> socket.socket:
    """A connection with more waiting answers than the kernel's buffers hold."""
    raw = _spoken(endpoint)
    raw.settimeout(2.0)
    with suppress(TimeoutError):
        for number in range(_ASKED):
            _say(raw, Hello(client=b"n" * 16, sequence=number + 1))
    return raw


def _spoken(endpoint: str) -> socket.socket:
    raw = connection(endpoint)
    raw.sendall(greeting(b"NULL") + ready(Identity=b""))
    until(raw, b"READY")
    return raw


def _say(raw: socket.socket, message: Message) -> None:
    (frame,) = encode(message)
    raw.sendall(b"\x02" + len(frame).to_bytes(8, "big") + bytes(frame))


KINDS: dict[str, list[Callable[[str], Any]]] = {
    "upload": [upload],
    "crash": [partial(crash, how=how) for how in _SEEN_AS],
    "slow": [slow],
}


def harm(kind: str, endpoint: str, done: Any) -> None:
    """Again and again; ``done`` counts."""
    end_with_parent()
    for each in cycle(KINDS[kind]):
        each(endpoint)
        done.value += 1

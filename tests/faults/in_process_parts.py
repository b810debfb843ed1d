"""Replacements of sockets, channels and processes for a whole server in one process: see :mod:`.in_process`."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import zmq

from tests.faults.model_files import ModelFiles

Bytes = bytes
Replies = list[tuple[bytes, list[bytes]]]


@dataclass(frozen=True)
class Frame:
    """A received frame, with the key of its sender."""

    bytes: Bytes
    user: str

    @property
    def buffer(self) -> Bytes:
        return self.bytes

    def __len__(self) -> int:
        return len(self.bytes)

    def get(self, name: str | int) -> str | int:
        """A property of the message; there is no real connection."""
        properties: dict[str | int, str | int] = {"User-Id": self.user, zmq.SRCFD: -1}
        return properties[name]


class Socket:
    def __init__(self) -> None:
        self.incoming: deque[list[Frame]] = deque()
        self.sent: Replies = []

    def send_multipart(self, frames: Sequence[Any], **_: Any) -> None:
        self.sent.append((bytes(frames[0]), [bytes(frame) for frame in frames[1:]]))

    def recv_multipart(self, **_: Any) -> list[Frame]:
        return self.incoming.popleft()

    def get_monitor_socket(self, *_: Any) -> Socket:
        return self

    def poll(self, *_: Any) -> int:
        return 0

    def getsockopt(self, *_: Any) -> bytes:
        """The last endpoint; memory cannot be shared over it."""
        return b"tcp:"

    def take_sent(self) -> Replies:
        sent, self.sent = self.sent, []
        return sent


class Line:
    """Replacement of a channel: passes messages on, and gives one order at a time."""

    def __init__(self, deliver: Callable[[dict[str, Any]], None]) -> None:
        self._deliver = deliver
        self.order: dict[str, Any] | None = None

    def send(self, message: dict[str, Any]) -> bool:
        self._deliver(message)
        return True

    offer = send

    def receive(self) -> dict[str, Any] | None:
        return self.order


class Held:
    """The disk of one process: its open files are closed with the process."""

    def __init__(self, files: ModelFiles) -> None:
        self._files = files
        self._handles: set[int] = set()

    def __getattr__(self, name: str) -> Any:
        target = getattr(self._files, name)
        if name not in ("create", "open", "lock"):
            return target

        def opening(*arguments: Any, **options: Any) -> int:
            handle: int = target(*arguments, **options)
            self._handles.add(handle)
            return handle

        return opening

    def end(self) -> None:
        for handle in self._handles:
            self._files.handles.pop(handle, None)


class Child:
    """Control's view of a worker: a line, and how to kill it."""

    pid = 0

    def __init__(self, do: Callable[[Child, dict[str, Any] | None], None]) -> None:
        self._do = do
        self.channel = Line(lambda order: do(self, order))

    def kill(self) -> None:
        self._do(self, None)

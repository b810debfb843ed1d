"""A network with faults: a TCP proxy in front of a server's control and data endpoints, in a separate thread.

It listens on a separate loopback address at the same ports as the server, which advertises ``0.0.0.0``: clients then
use the host by which they reached the control endpoint, as behind a container's port mapping. So data connections use
the proxy too, without knowledge of the client.

Bytes are passed on unit by unit (:mod:`.zmtp_stream`), so that a fault strikes a message at a known place:

==============  =====================================================================================================
kind            what becomes of the unit, and then of its connection
==============  =====================================================================================================
``delay``       comes up to 1.5 s later
``throttle``    and all that follows at some kilobytes a second
``drop``        is swallowed with all that follows, one way or both, and neither end gets an error
``cut``         a part of it comes, then both ends are closed or reset
``half-open``   one end is closed, the other one stays open and silent
``duplicate``   comes twice
``reorder``     comes after the next message that goes the same way, be it over another connection
``replay``      comes; and all bytes sent to the server over this connection are sent again over another one
``swap``        its connection is cut; the next one to a data endpoint is led to another session's
``restart``     its connection is cut; the server is killed and started again, and meanwhile no connection is let in
``flip``        one bit of it is turned
``truncate``    comes without its end, and the following messages come whole
==============  =====================================================================================================
"""

import asyncio
import contextlib
import socket
import struct
import threading
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from functools import partial

from tests.faults.zmtp_stream import Stream

#: Faults that leave each byte what it was, and those that do not: TCP's checksum lets one in 65 536 of them pass.
KINDS = (
    "delay", "throttle", "drop", "cut", "half-open", "duplicate", "reorder", "replay", "swap", "restart",
)  # fmt: skip
CORRUPTING = ("flip", "truncate")

_LONGEST_DELAY = 1.5
_FASTEST, _SLOWEST = 40_000, 2_000
_SLICE_SECONDS = 0.02
#: A replayed connection is listened to for so long, seconds.
_REPLAY_SECONDS = 0.3
_RECORDED_UNITS = 64


@dataclass(frozen=True)
class Fault:
    """A fault of the network, and its place.

    ``place`` ({"control", "data"}); ``way`` ({"in", "out"}): to the server, or to the client; ``at``: how many units
    pass there before; ``amount``: 0 … 1: how late, how slow, which bit.
    """

    kind: str
    place: str
    way: str
    at: int
    amount: float


@dataclass(eq=False)
class _Passage:
    """A client's connection and the proxy's connection to the server."""

    place: str
    port: int
    writers: dict[str, asyncio.StreamWriter]
    swallowed: set[str] = field(default_factory=set)
    rate: float = 0.0
    half_open: bool = False
    recorded: list[tuple[str, bytes]] = field(default_factory=list)

    def close(self, *, reset: bool = False) -> None:
        for writer in self.writers.values():
            _close(writer, reset=reset)


def _close(writer: asyncio.StreamWriter, *, reset: bool) -> None:
    if reset:
        raw = writer.get_extra_info("socket")
        with contextlib.suppress(OSError):
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        writer.transport.abort()
    else:
        writer.close()


class Network:
    """The network between one client, or one user's clients, and a server.

    ``host``: loopback address of the proxy; ``server`` (host, port): the server's control endpoint; ``ports``: the
    server's data ports; ``crossing``: data ports in use, shared by the networks of one server; ``restart``: kills and
    starts the server; called in a thread. ``struck``: kinds of the faults that have occurred since the last call of
    ``arm``.
    """

    def __init__(
        self,
        host: str,
        server: tuple[str, int],
        ports: Sequence[int],
        *,
        crossing: set[int],
        restart: Callable[[], None] = lambda: None,
    ) -> None:
        self.host, self._server, self._ports = host, server, (server[1], *ports)
        self._crossing, self._restart_server = crossing, restart
        self.struck: list[str] = []
        self._faults: dict[Fault, int] = {}
        self._late: dict[tuple[str, str], list[bytes]] = {}
        self._passages: set[_Passage] = set()
        self._swapping = self._shut = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"network {host}", daemon=True)
        self._thread.start()
        self._ready.wait()

    @property
    def endpoint(self) -> str:
        return f"tcp://{self.host}:{self._server[1]}"

    def arm(self, faults: Sequence[Fault]) -> None:
        self.struck = []
        self._faults = dict.fromkeys(faults, 0)

    def heal(self) -> None:
        """No further fault occurs; broken connections stay broken until their client connects again."""
        self._faults, self._late, self._swapping = {}, {}, False

    def close(self) -> None:
        if self._loop.is_closed():
            return
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        servers = [
            self._loop.run_until_complete(asyncio.start_server(partial(self._accept, port=port), self.host, port))
            for port in self._ports
        ]
        self._ready.set()
        self._loop.run_forever()
        for server in servers:
            server.close()
        for passage in list(self._passages):
            passage.close(reset=True)
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self._loop.run_until_complete(self._loop.shutdown_default_executor())
        self._loop.close()

    # --- connections -------------------------------------------------------------------------------------------------

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, port: int) -> None:
        try:
            if self._shut:
                raise OSError("the server is away")
            target = self._target(port)
            inner, outer = await asyncio.open_connection(self._server[0], target)
        except OSError:
            _close(writer, reset=True)
            return
        place = "control" if port == self._server[1] else "data"
        passage = _Passage(place, target, {"in": outer, "out": writer})
        self._passages.add(passage)
        try:
            await asyncio.gather(self._pump(passage, "in", reader), self._pump(passage, "out", inner))
        except asyncio.CancelledError:
            pass  # the network is closed; asyncio's own callback takes a cancelled connection for a fault
        finally:
            self._passages.discard(passage)
            passage.close()

    def _target(self, port: int) -> int:
        """The server's port for a connection to this one."""
        if port == self._server[1]:
            return port
        others = sorted(self._crossing - {port})
        self._crossing.add(port)
        if self._swapping and others:
            self._swapping = False
            return others[-1]
        return port

    async def _pump(self, passage: _Passage, way: str, reader: asyncio.StreamReader) -> None:
        """Pass on the bytes from one end, until it ends."""
        stream = Stream()
        with contextlib.suppress(OSError):
            while data := await reader.read(1 << 16):
                for kind, unit in stream.feed(data):
                    if way == "in" and len(passage.recorded) < _RECORDED_UNITS:
                        passage.recorded.append((kind, unit))
                    await self._pass(passage, way, kind, unit)
        if not passage.half_open:
            with contextlib.suppress(OSError):
                await self._write(passage, way, stream.rest)
            passage.close()

    async def _pass(self, passage: _Passage, way: str, kind: str, unit: bytes) -> None:
        fault = self._due(passage.place, way, kind)
        if fault is not None and way not in passage.swallowed:
            self.struck.append(fault.kind)
            await getattr(self, "_" + fault.kind.replace("-", "_"))(passage, way, unit, fault.amount)
            return
        await self._write(passage, way, unit)
        if kind == "message":
            for late in self._late.pop((passage.place, way), []):
                await self._write(passage, way, late)

    def _due(self, place: str, way: str, kind: str) -> Fault | None:
        """Count a unit; return the first fault that is due at it. Only messages may be duplicated, held or replayed."""
        due = None
        for fault, passed in list(self._faults.items()):
            if (fault.place, fault.way) != (place, way):
                continue
            fits = kind == "message" or fault.kind not in ("duplicate", "reorder", "replay")
            if due is None and passed >= fault.at and fits:
                due = fault
                self._faults.pop(fault, None)
            elif fault in self._faults:
                self._faults[fault] = passed + 1
        return due

    async def _write(self, passage: _Passage, way: str, data: bytes) -> None:
        if way in passage.swallowed or not data:
            return
        writer = passage.writers[way]
        size = int(passage.rate * _SLICE_SECONDS) or len(data)
        for start in range(0, len(data), size):
            writer.write(data[start : start + size])
            await writer.drain()
            if passage.rate:
                await asyncio.sleep(_SLICE_SECONDS)

    # --- faults ------------------------------------------------------------------------------------------------------

    async def _delay(self, passage: _Passage, way: str, unit: bytes, amount: float) -> None:
        await asyncio.sleep(_LONGEST_DELAY * amount)
        await self._write(passage, way, unit)

    async def _throttle(self, passage: _Passage, way: str, unit: bytes, amount: float) -> None:
        passage.rate = _FASTEST + (_SLOWEST - _FASTEST) * amount
        await self._write(passage, way, unit)

    async def _drop(self, passage: _Passage, way: str, _unit: bytes, amount: float) -> None:
        passage.swallowed |= {way} if amount < 0.5 else {"in", "out"}

    async def _cut(self, passage: _Passage, way: str, unit: bytes, amount: float) -> None:
        await self._write(passage, way, unit[: int(amount * len(unit))])
        passage.close(reset=len(unit) % 2 == 0)

    async def _half_open(self, passage: _Passage, _way: str, _unit: bytes, amount: float) -> None:
        passage.half_open, passage.swallowed = True, {"in", "out"}
        _close(passage.writers["in" if amount < 0.5 else "out"], reset=True)

    async def _duplicate(self, passage: _Passage, way: str, unit: bytes, _amount: float) -> None:
        await self._write(passage, way, unit + unit)

    async def _reorder(self, passage: _Passage, way: str, unit: bytes, _amount: float) -> None:
        self._late.setdefault((passage.place, way), []).append(unit)

    async def _replay(self, passage: _Passage, way: str, unit: bytes, _amount: float) -> None:
        await self._write(passage, way, unit)
        self._begin(self._send_again(passage.port, list(passage.recorded)))

    async def _swap(self, passage: _Passage, _way: str, _unit: bytes, _amount: float) -> None:
        self._swapping = True
        passage.close(reset=True)

    async def _restart(self, _passage: _Passage, _way: str, _unit: bytes, _amount: float) -> None:
        self._shut = True
        for each in list(self._passages):
            each.close(reset=True)
        self._begin(self._restarted())

    async def _flip(self, passage: _Passage, way: str, unit: bytes, amount: float) -> None:
        at, bit = divmod(int(amount * 8 * len(unit)), 8)
        await self._write(passage, way, unit[:at] + bytes([unit[at] ^ 1 << bit]) + unit[at + 1 :])

    async def _truncate(self, passage: _Passage, way: str, unit: bytes, amount: float) -> None:
        await self._write(passage, way, unit[: int(amount * len(unit))])

    def _begin(self, work: Coroutine[None, None, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _restarted(self) -> None:
        try:
            await self._loop.run_in_executor(None, self._restart_server)
        finally:
            self._shut = False

    async def _send_again(self, port: int, recorded: list[tuple[str, bytes]]) -> None:
        """A stranger repeats a client's bytes: the handshake first, and the messages after its answer."""
        with contextlib.suppress(OSError):
            reader, writer = await asyncio.open_connection(self._server[0], port)
            try:
                for messages in (False, True):
                    writer.writelines([unit for kind, unit in recorded if (kind == "message") is messages])
                    await writer.drain()
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(_REPLAY_SECONDS):
                            while await reader.read(1 << 16):
                                pass
            finally:
                _close(writer, reset=True)

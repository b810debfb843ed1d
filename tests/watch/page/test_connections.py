"""Many connections at one moment."""

import asyncio
import socket
from contextlib import ExitStack

import pytest

pytest.importorskip("uvicorn", reason="the extra monitor is not installed")

import uvicorn
from uvicorn.server import ServerState

from mesh_motion_server.watch.page import connections
from mesh_motion_server.watch.page.connections import BoundedProtocol


async def no_app(scope: object, receive: object, send: object) -> None:
    del scope, receive, send


async def left_of(burst: int) -> int:
    """How many connections are open after so many have come within one turn of the loop."""
    config = uvicorn.Config(no_app, http=BoundedProtocol, ws="none", lifespan="off", log_config=None)
    config.load()
    state, made = ServerState(), [0]

    def protocol() -> BoundedProtocol:
        made[0] += 1
        return BoundedProtocol(config, state, {})

    server = await asyncio.get_running_loop().create_server(protocol, "127.0.0.1", 0, backlog=64)
    with ExitStack() as lines:
        for _ in range(burst):  # the system takes them in, the loop gets to them afterwards
            lines.enter_context(socket.create_connection(server.sockets[0].getsockname(), timeout=60))
        async with asyncio.timeout(60):
            while made[0] < burst:
                await asyncio.sleep(0)
        for _ in range(10):  # those that were ended leave
            await asyncio.sleep(0)
        left = len(state.connections)
    server.close()
    return left


def test_a_burst_ends_as_many_as_it_brings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MOST", 4)
    assert asyncio.run(left_of(20)) == 4

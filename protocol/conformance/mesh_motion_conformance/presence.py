"""Check before the first case that a server answers at all."""

from __future__ import annotations

import time

import zmq
import zmq.utils.monitor

from mesh_motion_conformance.line import dealer

__all__ = ["Unreachable", "require_somebody"]

_CONNECTED = zmq.EVENT_CONNECTED
_GREETED = zmq.EVENT_HANDSHAKE_SUCCEEDED
_AGAIN = zmq.EVENT_CONNECT_RETRIED
_NOT_ADMITTED = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL


class Unreachable(Exception):
    """There is no server to test; the message names what was found instead."""


def require_somebody(endpoint: str, seconds: float) -> None:
    """Make one ZMTP connection and end it.

    A refused connection ends the check at once, silence ends it after ``seconds``; both raise :class:`Unreachable`.
    """
    socket = dealer(endpoint, seconds)
    events = socket.get_monitor_socket(_CONNECTED | _GREETED | _AGAIN | _NOT_ADMITTED)
    try:
        socket.connect(endpoint)
        _wait(events, endpoint, time.monotonic() + seconds)
    except zmq.ZMQError as error:
        raise Unreachable(f"the endpoint must be tcp://HOST:PORT or ipc:///PATH, got {endpoint!r}: {error}") from None
    finally:
        socket.disable_monitor()
        events.close()
        socket.close()


def _wait(events: zmq.Socket[bytes], endpoint: str, deadline: float) -> None:
    """Wait for a deciding event: a failed connection, a greeting, or the end of a connection."""
    connected = False
    while events.poll(max(0, round(1000 * (deadline - time.monotonic())))):
        event = zmq.utils.monitor.recv_monitor_message(events)["event"]
        if event == _GREETED:
            return
        if event & _NOT_ADMITTED:
            raise Unreachable(f"the server at {endpoint} asks for keys; the suite connects without")
        if event == _AGAIN and not connected:
            raise Unreachable(f"no server listens at {endpoint}")
        connected = connected or event == _CONNECTED
    raise Unreachable(f"no server at {endpoint} answers a ZMTP greeting")

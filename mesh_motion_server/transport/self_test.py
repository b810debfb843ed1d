"""Before a protected endpoint is announced, real connections test that it admits a key and refuses all others.

A CURVE socket whose handler is missing or wrong looks like any other; only a connection shows the difference.
"""

import time
from collections.abc import Callable

import zmq

from mesh_motion_server.transport.endpoints import EndpointError, connection_event
from mesh_motion_server.transport.protection import Protection

#: Longest wait for the result of one handshake.
_SECONDS = 5.0
_SUCCEEDED = zmq.EVENT_HANDSHAKE_SUCCEEDED
_ENDS = (
    _SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
)
#: A function that answers one waiting handshake request, for a process that is its own handler.
Turn = Callable[[], None]


class ProtectionError(EndpointError):
    """The endpoint admits or refuses the wrong clients."""


def check_admits(endpoint: str, protection: Protection, secret: bytes, turn: Turn) -> None:
    """Raise ProtectionError unless a client with this secret key gets a connection."""
    if not _connects(endpoint, protection, secret, turn):
        raise ProtectionError(
            f"the self-test failed: {endpoint} does not admit an allowed key",
            hint="is the handshake's handler running?",
        )


def check_refuses(endpoint: str, protection: Protection, turn: Turn = lambda: None) -> None:
    """Raise ProtectionError if a client with an unknown key or without a key gets a connection."""
    _, stranger = zmq.curve_keypair()
    for who, secret in (("an unknown key", stranger), ("a client without a key", b"")):
        if _connects(endpoint, protection, secret, turn):
            raise ProtectionError(f"the self-test failed: {endpoint} admits {who}")


def _connects(endpoint: str, protection: Protection, secret: bytes, turn: Turn) -> bool:
    """Return whether a handshake succeeds; no result within the time counts as a refusal."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    client = context.socket(zmq.DEALER)
    client.setsockopt(zmq.LINGER, 0)
    client.setsockopt(zmq.IPV6, int("[" in endpoint))
    if secret:
        client.setsockopt(zmq.CURVE_SERVERKEY, zmq.curve_public(protection.secret.encode()))
        client.setsockopt(zmq.CURVE_PUBLICKEY, zmq.curve_public(secret))
        client.setsockopt(zmq.CURVE_SECRETKEY, secret)
    events: zmq.Socket[bytes] = client.get_monitor_socket(_ENDS)
    try:
        client.connect(_from_here(endpoint))
        deadline = time.monotonic() + _SECONDS
        while time.monotonic() < deadline:
            turn()
            if events.poll(5):
                return connection_event(events)[0] == _SUCCEEDED
        return False
    finally:
        client.disable_monitor()
        events.close()
        client.close()
        context.term()


def _from_here(endpoint: str) -> str:
    """Replace a wildcard address by one that this machine reaches."""
    return endpoint.replace("://0.0.0.0:", "://127.0.0.1:").replace("://[::]:", "://[::1]:")

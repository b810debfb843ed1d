"""The only source of ZeroMQ sockets for tests: no send and no receive waits for ever."""

from functools import cache

import zmq

from tests.faults.waiting import PATIENCE


def limited_context(seconds: float = 2 * PATIENCE) -> zmq.Context[zmq.Socket[bytes]]:
    """A context whose sockets raise ``zmq.Again`` if a send or receive takes too long, and close at once.

    By default libzmq waits for ever: in a send if the only peer has refused the connection, and at the end of a process
    for unsent messages.
    """
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    for option, value in (
        (zmq.SNDTIMEO, round(1000 * seconds)),
        (zmq.RCVTIMEO, round(1000 * seconds)),
        (zmq.LINGER, 0),
    ):
        context.setsockopt(option, value)  # of each socket that it makes
    return context


@cache
def shared_context() -> zmq.Context[zmq.Socket[bytes]]:
    """One for a whole process."""
    return limited_context()

"""A whole server in one thread that listens at real sockets: a seeded fault shows from outside within milliseconds.

It is the one of :mod:`tests.faults.in_process`, with a model that computes next to nothing.
"""

import threading
import time
from contextlib import suppress

import zmq
from plain_model import PlainModel

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.endpoints import bind, router
from tests.faults.in_process import InProcessServer
from tests.faults.limited_context import limited_context


class ListeningServer(InProcessServer):
    """Runs from construction to :meth:`close`."""

    def __init__(self, folder):
        self.context, self.over = limited_context(), False
        brief = {"collective_timeout_seconds": 0.3, "lease_seconds": 0.3, "threads": 1}
        super().__init__(None, PlainModel, ServerSettings.from_mapping({"state_folder": str(folder)} | brief))
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def _bound(self, message_bytes):
        socket = router(self.context, message_bytes=message_bytes, queued=64, handshake_seconds=5.0)
        return socket, bind(socket, "tcp://127.0.0.1:*")

    def run(self):
        while not self.over:
            poller = zmq.Poller()
            for socket in (self._wire, *(worker.wire for worker in self._children.values())):
                poller.register(socket, zmq.POLLIN)
            ready = dict(poller.poll(5))
            self.now = time.monotonic()
            if self._wire in ready:
                self._gateway._receive()
            for child, worker in list(self._children.items()):
                if worker.wire in ready:
                    worker._receive()
                worker._keep_time()
                worker._report()
                if worker._over or worker.host.closed:
                    self._over(child)
            self._work()
            self._control.keep_time(self.now)

    def _over(self, child):
        self._disconnect(child)
        super()._over(child)

    def _killed(self, child):
        if child in self._children:
            self._disconnect(child)
        super()._killed(child)

    def _disconnect(self, child):
        worker = self._children[child]
        worker.disconnect()
        worker.host.close()
        worker.wire.close(0)

    def close(self):
        self.over = True
        self.thread.join()
        for child in list(self._children):
            with suppress(Exception):  # of a session with a seeded fault
                self._disconnect(child)
        self._wire.close(0)
        self.context.destroy(0)

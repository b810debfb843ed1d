"""The lease of a worker: a client that connects as soon as it knows the endpoint keeps it."""

import socket
import threading
import time

import pytest
import zmq
import zmq.utils.monitor
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.messages import Ping

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import template, worker
from tests.faults.limited_context import limited_context


class Line:
    """The supervisor's end of the line, in this process: a client that waits for the endpoint connects first."""

    def __init__(self, connect):
        self.connect, self.events = connect, []
        self.here, self.there = socket.socketpair()
        self.fileno = self.there.fileno

    def send(self, event):
        self.events.append(event)
        if event["event"] == "serving":
            self.connect(event["endpoint"])

    def offer(self, event):
        self.send(event)
        return True

    def receive(self):
        self.there.recv(1)
        return {"order": "drain"}

    def drain(self):
        self.here.send(b"d")

    def close(self):
        self.here.close()
        self.there.close()


class Host:
    label, partitions, epoch, state, step = "", 1, 1, "NEW", 0
    closed, next_deadline = False, None

    def __init__(self):
        self.suspended = False

    def suspend(self):
        self.suspended = True
        return []

    def close(self):
        pass


@pytest.fixture
def dealer():
    with limited_context() as context, context.socket(zmq.DEALER) as dealer:
        dealer.linger = 0
        yield dealer


def test_a_connection_made_at_once_keeps_the_lease(dealer, tmp_path, monkeypatch):
    def connect(endpoint):
        events = dealer.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        dealer.connect(endpoint)
        assert events.poll(30_000)
        dealer.disable_monitor()
        events.close()

    host, line = Host(), Line(connect)
    signals, _other = socket.socketpair()
    monkeypatch.setattr(template, "limit_address_space", lambda allowance: None)
    monkeypatch.setattr(template, "limit_descriptors", lambda count: None)
    monkeypatch.setattr(template, "_host", lambda *given: host)
    settings = ServerSettings(state_folder=tmp_path, lease_seconds=0.1, idle_seconds=0.3)
    order = {"order": "create", "endpoint": "tcp://127.0.0.1:0", "owner": "", "settings": settings.model_dump_json()}
    order["root"] = [0, 0]
    serving = threading.Thread(
        target=template._serve, args=(line, order, (None, lambda folder, identity: folder), signals), daemon=True
    )
    serving.start()
    time.sleep(1.0)  # three times what would end it
    dealer.send_multipart(encode(Ping(client=b"c" * 16, sequence=1)), zmq.NOBLOCK)
    assert dealer.poll(10_000), "the worker has ended"
    assert decode(dealer.recv_multipart()).type == "PONG"
    assert not host.suspended
    line.drain()
    serving.join(30)
    line.close()
    signals.close()
    _other.close()


def test_a_viewer_keeps_no_lease():
    with limited_context() as context, context.socket(zmq.ROUTER) as router:
        lease = worker.Lease(router, 0.0)
        port = router.bind_to_random_port("tcp://127.0.0.1")
        with context.socket(zmq.DEALER) as holder, context.socket(zmq.DEALER) as viewer:
            for dealer in (holder, viewer):
                dealer.linger = 0
                dealer.connect(f"tcp://127.0.0.1:{port}")
                dealer.send(b"hello" if dealer is holder else b"look")
            said = [router.recv_multipart(copy=False)[-1] for _ in range(2)]
            (looking,) = [frame for frame in said if frame.bytes == b"look"]
            lease.pass_over(looking, 10.0)
            assert lease.alone(20.0) == 0.0  # the holder
            holder.close()
            while not lease.alone(31.0):
                lease.monitor.poll(10_000)
                lease.update(30.0)
            assert lease.alone(31.0) == 1.0
            lease.pass_over(looking, 40.0)  # however often it looks
            assert lease.alone(50.0) == 20.0
        assert lease.monitor.poll(10_000)
        lease.update(60.0)
        assert lease.alone(70.0) == 40.0  # nor does its end count as a holder's
        lease.monitor.close()
        router.disable_monitor()

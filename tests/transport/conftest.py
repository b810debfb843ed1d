"""A server with the fake service in separate processes, and a minimal client."""

import json
import os
import uuid
from pathlib import Path

import numpy as np
import pytest
import zmq
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.key_files import PublicKey, SecretKey
from mesh_motion_protocol.messages import Join, Move, Open

from mesh_motion_server.security.key_folder import make_client_keys
from tests.faults.limited_context import limited_context
from tests.faults.server_process import ServerProcess
from tests.faults.waiting import wait_until

HERE = Path(__file__).parent
PATIENCE = 30.0
#: A checkout on the path of the tests is that of the server too.
PYTHONPATH = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])


class Server(ServerProcess):
    def __init__(self, folder, *arguments, environment=(), **options):
        super().__init__(folder, environment={"PYTHONPATH": PYTHONPATH} | dict(environment), **options)
        self._arguments = arguments

    def command(self, ready):
        return [str(HERE / "run_server.py"), json.dumps(self.settings), str(ready), *self._arguments]


class Wire:
    """A DEALER that sends one request at a time."""

    def __init__(self, context, endpoint, keys=None, routing_id=b"", *, at_once=True):
        self.socket = context.socket(zmq.DEALER)
        if keys:
            self.socket.curve_serverkey, self.socket.curve_secretkey = keys.server.encode(), keys.secret.encode()
            self.socket.curve_publickey = zmq.curve_public(keys.secret.encode())
        if routing_id:
            self.socket.setsockopt(zmq.ROUTING_ID, routing_id)
        self.endpoint = endpoint
        self.client, self.sequence = uuid.uuid4().bytes, 0
        if at_once:
            self.connect()

    def connect(self):
        self.socket.connect(self.endpoint)

    def send(self, kind, **fields):
        if "sequence" not in fields:
            self.sequence += 1
        message = kind(**({"client": self.client, "sequence": self.sequence} | fields))
        self.socket.send_multipart(encode(message))

    def send_frames(self, *frames):
        self.socket.send_multipart(frames)

    def receive(self, seconds=PATIENCE):
        assert self.socket.poll(1000 * seconds), "no reply"
        return decode(self.socket.recv_multipart())

    def ask(self, kind, **fields):
        self.send(kind, **fields)
        return self.receive()


def server_starter(base, servers):
    def start(*arguments, ready=True, **settings):
        folder = base / f"server{len(servers)}" if "folder" not in settings else settings.pop("folder")
        servers.append(Server(folder, *arguments, **settings))
        servers[-1].start() if ready else servers[-1].launch()
        return servers[-1]

    return start


@pytest.fixture
def start(tmp_path):
    servers = []
    yield server_starter(tmp_path, servers)
    for server in servers:
        server.stop()


@pytest.fixture(scope="module")
def lasting_server(tmp_path_factory):
    """One server for a module whose tests do not change it."""
    servers = []
    yield server_starter(tmp_path_factory.mktemp("lasting"), servers)()
    for server in servers:
        server.stop()


@pytest.fixture
def connect():
    context = limited_context()
    wires = []

    def connect(endpoint, keys=None, routing_id=b"", *, at_once=True):
        wires.append(Wire(context, endpoint, keys, routing_id, at_once=at_once))
        return wires[-1]

    yield connect
    for wire in wires:
        wire.socket.close()
    context.term()


@pytest.fixture
def open_session(connect):
    def open_session(server, **fields):
        opened = connect(server.endpoint).ask(Open, dimension=2, **fields)
        assert opened.type == "OPENED", opened
        data = connect(opened.endpoint)
        at = {"session": opened.session, "epoch": opened.epoch}
        assert data.ask(Join, **at, token=opened.token).type == "JOINED"
        return opened, data, at

    return open_session


@pytest.fixture
def open_moving(open_session):
    """Opens a session whose worker computes step 1 until the file ``go`` is there."""

    def open_moving(server):
        opened, data, at = open_session(server, label="slow")
        data.send(Move, **at, step=1, frame="reference", displacement=np.ones((2, 2)))
        wait_until((server.state / f"moving-{opened.session}").exists, "the move runs")
        return opened, data

    return open_moving


class ClientKeys:
    def __init__(self, name, folder, server):
        self.public = make_client_keys(name, folder).key
        self.secret = SecretKey.load(folder / f"{name}.secret").key
        self.server = server


@pytest.fixture(scope="session")
def make_keys(tmp_path_factory):
    """(name, the server's key folder) → keys that are not admitted yet."""

    def make(name, server_folder):
        server = PublicKey.load(server_folder / "server.public").key
        return ClientKeys(name, tmp_path_factory.mktemp("client"), server)

    return make


@pytest.fixture(scope="module")
def make_module_server(tmp_path_factory):
    servers = []
    yield server_starter(tmp_path_factory.mktemp("module"), servers)
    for server in servers:
        server.stop()

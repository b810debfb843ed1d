"""A server with a plain model, a small mesh, and a proxy that breaks connections."""

import contextlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client import Keys, Mesh, Patch, connect

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys
from tests.faults.server_process import ServerProcess

HERE = Path(__file__).parent
#: A checkout on the path of the tests is that of the server too.
PYTHONPATH = os.pathsep.join([str(HERE), str(HERE.parent / "shared"), *filter(None, [os.environ.get("PYTHONPATH")])])


class PlainServer(ServerProcess):
    def __init__(self, folder, **settings):
        environment = {"PYTHONPATH": PYTHONPATH, "PLAIN_FOLDER": str(folder)}
        super().__init__(folder, environment=environment, **{"lease_seconds": 1.0} | settings)

    def command(self, ready):
        return [str(HERE / "run_server.py"), json.dumps(self.settings), str(ready)]

    def moves(self):
        with contextlib.suppress(OSError):
            return len((self.folder / "moves").read_text().splitlines())
        return 0

    @contextlib.contextmanager
    def hold(self):
        path = self.folder / "hold"
        path.touch()
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def running_server(folder, **settings):
    running = PlainServer(folder, **settings).start()
    try:
        yield running
    finally:
        (folder / "hold").unlink(missing_ok=True)
        running.stop()


@pytest.fixture
def server(lasting_server):
    """A server that the test may kill and restart; its count of moves is 0."""
    (lasting_server.folder / "moves").unlink(missing_ok=True)
    yield lasting_server
    (lasting_server.folder / "hold").unlink(missing_ok=True)
    if not lasting_server.runs:
        lasting_server.start()


@pytest.fixture(scope="module")
def server_with(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        yield lambda **settings: stack.enter_context(running_server(tmp_path_factory.mktemp("server"), **settings))


@pytest.fixture(scope="module")
def keyed_server(tmp_path_factory):
    """A server with keys that admits alice, but not mallory."""
    folder = tmp_path_factory.mktemp("keyed")
    make_server_keys(folder / "keys")

    def keys_of(name, roles):
        public = make_client_keys(name, folder / name)
        if roles:
            admit(public.key, folder / "keys", name=name, roles=roles)
        return Keys.load(folder / name / f"{name}.secret", folder / "keys" / "server.public")

    with running_server(folder, keys_folder=str(folder / "keys")) as running:
        running.alice, running.mallory = (
            keys_of(name, roles) for name, roles in (("alice", ["owner"]), ("mallory", []))
        )
        yield running


@pytest.fixture(scope="module")
def lasting_server(server_with):
    return server_with()


@pytest.fixture
def mesh():
    x = np.arange(4) / 4  # exact in binary
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    i = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + 5], axis=1), np.stack([i, i + 5, i + 4], axis=1)])
    left, right = np.arange(0, 16, 4), np.arange(3, 16, 4)
    return Mesh(points, {"triangle": triangles}, {"left": Patch("moving", left), "right": Patch("fixed", right)})


@pytest.fixture
def client(server):
    with connect(server.endpoint, timeout=20, compute_timeout=30) as client:
        yield client


@pytest.fixture
def session(client, mesh):
    with client.open(mesh, {"support_radius": 1.0}, label="test") as session:
        yield session

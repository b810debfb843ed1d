"""Client of the mesh-motion server.

::

    from mesh_motion_client import Mesh, Patch, connect

    mesh = Mesh(points, cells={"triangle": triangles},
                patches={"flag": Patch("moving", flag), "walls": Patch("fixed", walls)})
    with connect("tcp://127.0.0.1:7440") as server, server.open(mesh, {"support_radius": 0.5}) as session:
        for step in range(steps):
            while not converged:
                moved = session.move(displacements)      # totals since the mesh given, in order of session.moving_nodes
                ...                                      # moved.displacement, moved.quality, moved.warnings
            session.commit()

``connect()`` without an endpoint starts a private server. It needs numpy, msgpack and pyzmq. For a server that asks for
keys: ``connect(endpoint, keys=Keys.load("alice.secret", "server.public"))``, or name the files in the environment
(:mod:`.keys`).

In a notebook: the objects describe themselves, ``mesh.plot()``, ``moved.plot()`` and ``session.plot()`` draw them, and
``progress(steps)`` shows how far a loop is.

With an event loop the same calls are awaited: :mod:`.aio`. Meshes come from files (``Mesh.load``), from Gmsh, meshio
and PyVista (``Mesh.from_gmsh()``, …), and go to PyVista (``moved.to_pyvista()``).

As a differentiable function of PyTorch and JAX: ``mesh_motion_client.torch``, ``mesh_motion_client.jax``.

Without MPI, the workers of a Dask cluster are the ranks of a session: :mod:`.dask_ranks`.

Modules, from the outside in: :mod:`.aio`, :mod:`.server`, :mod:`.motion_function`, :mod:`.session`, :mod:`.opened`,
:mod:`.moved`, :mod:`.committed`, :mod:`.mesh`, :mod:`.exchange`, :mod:`.display`, :mod:`.settings`, :mod:`.quality`,
:mod:`.credentials`, :mod:`.control`, :mod:`.connection`, :mod:`.keys`, :mod:`.embedded`, :mod:`.errors`.
"""

from mesh_motion_protocol import __version__ as __version__
from mesh_motion_protocol.errors import (
    DataLoss,
    InvalidInput,
    MeshMotionError,
    MeshMotionWarning,
    QualityRefused,
    ResourceExhausted,
    ServerFault,
    SessionError,
    StepsLost,
    Timeout,
    Unavailable,
    Unsupported,
)

from mesh_motion_client.committed import Committed
from mesh_motion_client.credentials import Credentials
from mesh_motion_client.display import progress
from mesh_motion_client.keys import Keys
from mesh_motion_client.mesh import Mesh, Patch
from mesh_motion_client.moved import Moved
from mesh_motion_client.server import Server, connect
from mesh_motion_client.session import Session
from mesh_motion_client.settings import Settings

__all__ = [
    "Committed",
    "Credentials",
    "DataLoss",
    "InvalidInput",
    "Keys",
    "Mesh",
    "MeshMotionError",
    "MeshMotionWarning",
    "Moved",
    "Patch",
    "QualityRefused",
    "ResourceExhausted",
    "Server",
    "ServerFault",
    "Session",
    "SessionError",
    "Settings",
    "StepsLost",
    "Timeout",
    "Unavailable",
    "Unsupported",
    "connect",
    "progress",
]

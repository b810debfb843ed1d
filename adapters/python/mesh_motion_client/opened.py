"""How a session is opened: its connections, its mesh, and the server's first answers."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, SessionError
from mesh_motion_protocol.messages import Build, Built, Fetch, Fetched, Joined, Upload, Uploaded
from numpy.typing import NDArray

from mesh_motion_client.control import Control
from mesh_motion_client.courier import Courier
from mesh_motion_client.credentials import Credentials
from mesh_motion_client.display import Described, progress
from mesh_motion_client.mesh import Mesh
from mesh_motion_client.own_cells import OwnCells
from mesh_motion_client.quality import QualitySummary
from mesh_motion_client.settings import Settings
from mesh_motion_client.volume import Volume

__all__ = ["OpenedSession"]


class OpenedSession(Described):
    """A connected session; :class:`.session.Session` adds the attributes and the calls of users."""

    def __init__(
        self,
        control: Control,
        credentials: Credentials,
        *,
        partition: int,
        timeout: float,
        compute_timeout: float,
        shares_memory: bool = False,
    ) -> None:
        self.credentials = credentials
        self.partition = partition
        self.durable_step = 0
        self.dimension = 0
        self.moving_nodes: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self.settings: Settings = {}
        self.mesh_report: dict[str, Any] = {}
        self.quality: QualitySummary | None = None
        self.derivatives: bool | None = None
        self.time: float | None = None
        self._patches: dict[str, NDArray[np.int64]] = {}
        self._extent = 0.0
        self._mesh: Mesh | None = None
        self._evaluation = "server"
        self._own_cells: OwnCells | None = None
        self._control = control
        self._courier = Courier(control, credentials, partition, shares_memory=shares_memory)
        self._timeout = timeout
        self._compute_timeout = compute_timeout
        self._closed = False
        self._committed = 0, 0  # the step, and its iteration

    def join(self, endpoint: str, epoch: int) -> Joined:
        """Connect to the worker; a built session is then ready for use."""
        joined = self._courier.join(endpoint, epoch, self._timeout)
        self.dimension, self._courier.step, self._courier.iteration = joined.dimension, joined.step, joined.iteration
        self._evaluation, self.time = joined.evaluation, joined.time
        if joined.moving_nodes is not None:
            self.moving_nodes = self._in_mesh(joined.moving_nodes)
            self._extent = joined.extent
            self._courier.may_resume = joined.partitions == 1
        if joined.patch_nodes is not None:
            ends = np.cumsum([count for _, count in joined.moving_patches], dtype=np.int64)
            parts = np.split(self._in_mesh(joined.patch_nodes), ends)  # np.split adds an empty last part
            self._patches = {name: nodes for (name, _), nodes in zip(joined.moving_patches, parts, strict=False)}
        return joined

    def upload(self, mesh: Mesh, partitions: int, *, shown: bool = False) -> Built:
        """Send the mesh and wait until all partitions have sent theirs and the server has checked the whole."""
        self.take(mesh)
        own = self._own_cells and self._own_cells.volume
        parts = (own or mesh).parts(**self._courier.address)
        build = Build(**self._courier.address, reach=None if own is None else 0.0)
        requests: list[Upload | Build] = [*parts, build]
        for request in progress(requests, "mesh sent in parts, and built") if shown else requests:
            if isinstance(request, Upload):
                self._courier.deliver(request, Uploaded, self._timeout)
            else:
                built = self._courier.deliver(request, Built, self._compute_timeout)
        while own and built.reach:  # cells near moving walls are missing
            assert built.wall is not None
            for part in own.near(built.wall, built.reach, **self._courier.address):
                self._courier.deliver(part, Uploaded, self._timeout)
            build = Build(**self._courier.address, reach=built.reach)
            built = self._courier.deliver(build, Built, self._compute_timeout)
        self.moving_nodes = self._in_mesh(built.moving_nodes)
        self._courier.may_resume = partitions == 1
        self.settings, self.mesh_report = cast(Settings, built.settings), built.mesh
        self.quality, self.derivatives = cast(QualitySummary, built.quality), built.derivatives
        self._extent = float(np.ptp(built.mesh["box"], axis=0).max())
        return built

    def take(self, mesh: Mesh) -> None:
        """Store the mesh of this partition, with which the session is opened."""
        if self._evaluation == "client":
            self._own_cells = OwnCells(Volume(mesh), self._courier)
        self._mesh = mesh
        self._patches = {name: patch.nodes for name, patch in mesh.patches.items() if patch.role == "moving"}

    def take_again(self, mesh: Mesh) -> None:
        """Store the mesh of a session that was opened before.

        Raises
        ------
        InvalidInput
            If it is not the mesh of that session.
        """
        self.take(mesh)
        fetched = self._courier.deliver(Fetch(**self._address, what="reference"), Fetched, self._timeout)
        own = self._own_cells
        if not (np.array_equal(fetched.points, mesh.points) if own is None else own.volume.take_again(fetched)):
            raise InvalidInput(
                "the mesh is not the one that this session was opened with",
                hint="give the same points, cells and patches in the same order",
            )
        self.moving_nodes = self._in_mesh(self.moving_nodes)

    def leave(self) -> None:
        """Close the connections without a message to the server: another holder has the session, or this partition."""
        self._closed = True
        self._courier.disconnect()
        self._control.close()

    def _in_mesh(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return nodes (k,) in the numbering of the mesh, instead of that of the upload."""
        return nodes if self._own_cells is None else self._own_cells.volume.nodes[nodes]

    def _own_cells_if_here(self) -> OwnCells | None:
        """The cells, if the client evaluates the volume.

        Raises
        ------
        InvalidInput
            If the client evaluates the volume and the mesh is not known.
        """
        if self._evaluation == "client" and self._own_cells is None:
            raise InvalidInput(
                "the volume of this session stays with the client, and the mesh is not known here",
                hint="give the mesh: server.resume(credentials, mesh), or server.join(credentials, mesh, partition=…)",
            )
        return self._own_cells

    @property
    def _address(self) -> dict[str, Any]:
        """Common fields of the session's requests; an error if the session is closed."""
        if self._closed:
            raise SessionError(
                "the session is closed", hint="server.resume(session.credentials) resumes a kept session"
            )
        return self._courier.address

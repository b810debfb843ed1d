"""The entry to the client: connect to a server, or start a private one, and open sessions on it."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from types import TracebackType
from typing import Any, Self

from mesh_motion_protocol import __version__
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, SessionError, Timeout, Unavailable
from mesh_motion_protocol.messages import Hello, List, Listed, Open, Opened, Probe, Probed, Resume, Resumed, Welcome
from mesh_motion_protocol.shared_memory import FEATURE, SUPPORTED

from mesh_motion_client.connection import ConnectionLost, seconds_left
from mesh_motion_client.control import Control
from mesh_motion_client.credentials import Credentials
from mesh_motion_client.display import Described
from mesh_motion_client.embedded import EmbeddedServer
from mesh_motion_client.keys import Keys
from mesh_motion_client.mesh import Mesh
from mesh_motion_client.session import Session
from mesh_motion_client.settings import Settings

__all__ = ["Server", "connect"]

AGENT = f"mesh_motion_client {__version__}"
#: Number of times that a session is opened again: if its worker dies during the upload, there is nothing to resume.
_OPEN_ATTEMPTS = 3
#: Seconds for a server's first session, which waits for the start of a worker: long on a busy machine.
_COLD_START_SECONDS = 300.0


class Server(Described):
    """A connection to a server; used by one thread at a time. Made by :func:`connect`.

    Attributes
    ----------
    endpoint : str
    welcome : Welcome
        The server's version, limits and name, and the levels of durability that it offers.
    """

    def __init__(
        self, endpoint: str, *, timeout: float, compute_timeout: float, keys: Keys | None = None, durability: str = ""
    ) -> None:
        self.endpoint = endpoint
        self._durability = durability
        self._keys = keys
        self._timeout = timeout
        self._compute_timeout = compute_timeout
        self._control = Control(endpoint, keys)
        self._embedded: EmbeddedServer | None = None
        self._closed = False
        try:
            features = [FEATURE] if SUPPORTED else []
            self.welcome = self._control.ask(Hello, Welcome, timeout, agent=AGENT, features=features)
        except (Timeout, ConnectionLost) as error:
            self._control.close()
            raise Unavailable(
                f"no server answers at {endpoint} within {timeout} s",
                hint="is it running (`mesh-motion serve`), and is the given server key its key?"
                if keys
                else "is it running (`mesh-motion serve`), and without --keys?",
            ) from error
        except MeshMotionError:
            self._control.close()
            raise

    def open(
        self,
        mesh: Mesh,
        settings: Settings | Mapping[str, Any] | None = None,
        *,
        partitions: int = 1,
        partition: int = 0,
        label: str = "",
        durability: str | None = None,
        evaluation: str = "server",
        time: float = 0.0,
        time_levels: str = "",
        show_progress: bool = False,
        announce: Callable[[Credentials], None] | None = None,
    ) -> Session:
        """Open a session and upload its mesh.

        Parameters
        ----------
        mesh : Mesh
            With several partitions: this partition's part, with ``global_ids``.
        settings : Settings, optional
            Keys of the case file's ``[method]``; keys that are left out have their defaults.
        partitions, partition : int
            Number of partitions of the session, and the number of this one.
        label : str
            Shown in logs and lists.
        durability : {"full", "replay", "relaxed", ""}, optional
            The condition that a commit waits for. "": the server's default; None: the value given to :func:`connect`.
            "full" and "replay" lose nothing that was committed; "relaxed" may lose the steps after
            ``session.durable_step``, and says so by :class:`~.errors.StepsLost`.
        evaluation : {"server", "client"}
            Who moves and judges the nodes of the volume. "client": only the boundary is uploaded, and this process
            evaluates the field that each move answers; it needs ``mesh-motion-server[server]`` here.
        time : float
            Time of the uploaded mesh, seconds: the start of the run.
        time_levels : {"", "bdf2", "bossak"}
            The scheme for which each commit stores earlier time levels (positions, or velocities and accelerations), so
            that moves can return its velocities. Each commit then writes twice or three times as much.
        show_progress : bool
            Show the progress of the upload and of the build, with :func:`.display.progress`.
        announce : callable, optional
            Called with the credentials before the upload. With several partitions, give them to the other processes,
            which call :meth:`join`; the upload ends when all have sent their parts.

        Raises
        ------
        InvalidInput
            Naming the first offender in the mesh or the settings.
        """
        if not isinstance(mesh, Mesh):
            raise InvalidInput(
                f"mesh must be a Mesh, got {type(mesh).__name__}",
                hint="Mesh(points, cells, patches), or Mesh.load(path, roles) of a file",
            )
        if not isinstance(settings, Mapping | None):
            raise InvalidInput(
                f"settings must be a dict, key → value, got {type(settings).__name__}",
                hint="as {'support_radius': 0.5}",
            )
        if partitions > 1 and mesh.global_ids is None:
            raise InvalidInput("with several partitions a mesh must have global_ids", code="INVALID_ARGUMENT.PARTITION")
        attempts = _OPEN_ATTEMPTS if announce is None else 1
        while True:
            attempts -= 1
            try:
                return self._open(
                    mesh,
                    settings,
                    partitions,
                    partition,
                    show_progress,
                    announce,
                    label=label,
                    durability=self._durability if durability is None else durability,
                    evaluation=evaluation,
                    time=float(time),
                    time_levels=time_levels,
                )
            except (Unavailable, SessionError) as error:
                # NOT_FOUND of the session just opened: the server was restarted before the session was built
                gone = isinstance(error, Unavailable) or error.code == "NOT_FOUND"
                if attempts <= 0 or not gone:
                    raise

    def _open(
        self,
        mesh: Mesh,
        settings: Settings | Mapping[str, Any] | None,
        partitions: int,
        partition: int,
        show_progress: bool,
        announce: Callable[[Credentials], None] | None,
        **fields: Any,
    ) -> Session:
        opened = self._connected.ask(
            Open,
            Opened,
            max(self._timeout, min(self._compute_timeout, _COLD_START_SECONDS)),
            dimension=mesh.dimension,
            partitions=partitions,
            settings=dict(settings or {}),
            bytes_reserved=mesh.nbytes if partitions == 1 and fields["evaluation"] == "server" else 0,
            **fields,
        )
        session = self._session(Credentials(opened.session, opened.token), partition)
        with _closing_on_error(session, "discard"):
            session.join(opened.endpoint, opened.epoch)
            if announce is not None:
                announce(session.credentials)
            session.upload(mesh, partitions, shown=show_progress)
        return session

    def join(self, credentials: Credentials, mesh: Mesh | None = None, *, partition: int) -> Session:
        """Join a session that another partition opened or resumed; with ``mesh``, upload the part of this partition.

        A built session needs no mesh, unless the client evaluates its volume.
        """
        deadline = time.monotonic() + self._timeout
        fields = _named(credentials)
        while True:
            probed = self._connected.ask(Probe, Probed, max(seconds_left(deadline), 1.0), **fields)
            if probed.worker == "alive":
                break
            if not seconds_left(deadline):
                raise Unavailable(
                    f"the session's worker is {probed.worker}", hint="resume the session from one partition first"
                )
            time.sleep(0.05)
        session = self._session(credentials, partition)
        with _closing_on_error(session, "keep"):
            joined = session.join(probed.endpoint, probed.epoch)
            if mesh is not None and joined.moving_nodes is None:
                session.upload(mesh, joined.partitions)
            elif mesh is not None:
                session.take_again(mesh)
        return session

    def resume(self, credentials: Credentials, mesh: Mesh | None = None, *, partition: int = 0) -> Session:
        """Resume a session at its last committed step; earlier holders are fenced off.

        ``mesh``: the partition's mesh from the opening of the session; needed if the client evaluates the volume.
        """
        fields = _named(credentials)
        resumed = self._connected.ask(Resume, Resumed, self._compute_timeout, **fields)
        session = self._session(credentials, partition)
        with _closing_on_error(session, "keep"):
            session.join(resumed.endpoint, resumed.epoch)
            session.durable_step = resumed.step
            if mesh is not None:
                session.take_again(mesh)
        return session

    def sessions(self) -> list[dict[str, Any]]:
        """List all sessions of the server: session, label, state, step, partitions, worker."""
        found: list[dict[str, Any]] = []
        more, after = True, ""
        while more:
            page = self._connected.ask(List, Listed, self._timeout, after=after)
            found += page.sessions
            more, after = page.more, found[-1]["session"] if found else ""
        return found

    def description(self) -> list[str]:
        """The endpoint, the server's version, and whether the server is private or the connection closed."""
        kind = "closed" if self._closed else "private" if self._embedded else "connected"
        version = ".".join(map(str, self.welcome.version))
        return [
            f"Server {self.endpoint}: {kind}",
            f"{self.welcome.server}, protocol {version}, durability {self.welcome.durability[0]!r} by default",
        ]

    def close(self) -> None:
        """End the connection, and the embedded server if there is one; idempotent."""
        self._closed = True
        self._control.close()
        if self._embedded is not None:
            self._embedded.stop()
            self._embedded = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    @property
    def _connected(self) -> Control:
        """The control connection; an error after :meth:`close`, so that no call waits for a closed server."""
        if self._closed:
            raise Unavailable("the connection to the server is closed", hint="connect again")
        return self._control

    def _session(self, credentials: Credentials, partition: int) -> Session:
        """Make a session with its own control connection, so that each session may be used in its own thread."""
        return Session(
            Control(self.endpoint, self._keys),
            credentials,
            partition=partition,
            timeout=self._timeout,
            compute_timeout=self._compute_timeout,
            shares_memory=FEATURE in self.welcome.features,
        )

    @classmethod
    def embedded(
        cls,
        state: str | os.PathLike[str] | None,
        *,
        timeout: float,
        compute_timeout: float,
        options: Sequence[str] = (),
        durability: str = "",
    ) -> Server:
        """A private server in a process of its own."""
        embedded = EmbeddedServer(state, timeout, options)
        try:
            server = cls(embedded.endpoint, timeout=timeout, compute_timeout=compute_timeout, durability=durability)
        except MeshMotionError:
            embedded.stop()
            raise
        server._embedded = embedded
        return server


def connect(
    endpoint: str | None = None,
    *,
    timeout: float = 60.0,
    compute_timeout: float = 1800.0,
    state: str | os.PathLike[str] | None = None,
    server_options: Sequence[str] = (),
    keys: Keys | None = None,
    durability: str = "",
) -> Server:
    """Connect to a server.

    Parameters
    ----------
    endpoint : str, optional
        ``tcp://HOST:PORT`` or ``ipc:///path``. None starts a private server that ends with this process.
    timeout : float
        Seconds for requests without computation.
    compute_timeout : float
        Seconds for requests with computation: build, move, commit, resume.
    state : path, optional
        For a private server: the folder of its sessions; None: a temporary folder.
    server_options : sequence of str
        For a private server: further options of ``mesh-motion serve``.
    keys : Keys, optional
        Keys for a server that requires them; None: the keys named in the environment, if any. A private server needs no
        keys.
    durability : {"full", "replay", "relaxed", ""}
        Durability of the sessions opened on this connection, see :meth:`Server.open`; "": the server's default.

    Raises
    ------
    Unavailable
        If no server answers in time.
    SessionError
        UNAUTHENTICATED, if the server does not admit the key.

    Examples
    --------
    >>> with connect() as server, server.open(mesh, {"support_radius": 0.5}) as session:   # doctest: +SKIP
    ...     moved = session.move(displacements)
    ...     session.commit()
    """
    for name, seconds in (("timeout", timeout), ("compute_timeout", compute_timeout)):
        if not isinstance(seconds, Real) or not seconds >= 0:
            raise InvalidInput(f"{name} must be a number of seconds, got {seconds!r}")
    if endpoint is None:
        return Server.embedded(
            state, timeout=timeout, compute_timeout=compute_timeout, options=server_options, durability=durability
        )
    keys = keys if keys is not None else Keys.from_environment()
    return Server(endpoint, timeout=timeout, compute_timeout=compute_timeout, keys=keys, durability=durability)


def _named(credentials: Credentials) -> dict[str, Any]:
    """The fields of a request that name a session."""
    if not isinstance(credentials, Credentials):
        raise InvalidInput(
            f"credentials must be Credentials, got {type(credentials).__name__}",
            hint="session.credentials, or Credentials.load(path) of a file that session.credentials.save(path) wrote",
        )
    return {"session": credentials.session, "token": credentials.token}


@contextlib.contextmanager
def _closing_on_error(session: Session, outcome: Any) -> Any:
    """Close a session that could not be made ready."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(MeshMotionError):
            session.close(outcome)
        raise

"""OpenFOAM as the fluid of a coupled computation.

The solver runs all the time; its boundary condition ``coupledDisplacement`` (adapters/openfoam) sends a request to this
process over a socket once in each PIMPLE outer corrector. It sends forces and receives displacements; the last answer
of a window is marked as the last. Each corrector computes the window from its start again, as PIMPLE does: from the
fields of the previous time, with the newest fields as a first guess. ``couplingLink.H`` has the messages.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
import zmq
from numpy.typing import NDArray

from mesh_motion_fsi.errors import ParticipantError, RecordError, SetupError

__all__ = ["OpenFoam", "Request"]

Array = NDArray[np.float64]
_POLL = 200  # ms between two looks at whether the solver still lives
_VERSION = "1"


@dataclass(frozen=True)
class Request:
    """The fluid's request for displacements, with its forces.

    Attributes
    ----------
    window, iteration : int
        Both count from 1. Iteration 1 begins a window; the solver has then written the previous one.
    time, dt : float
        End and length of the window, time unit.
    forces : (f, 3) array
        On the patch's faces, force unit.
    """

    window: int
    iteration: int
    time: float
    dt: float
    forces: Array


class OpenFoam:
    """A case whose moving patch has the boundary condition ``coupledDisplacement``.

    Parameters
    ----------
    case : path
        The case's folder, with a mesh.
    application : str
        The solver.
    environment : dict of str, optional
        Further variables.
    patience : float
        Seconds that the solver may take for one outer corrector.

    Attributes
    ----------
    points, faces : (p, 3) and (f, 3) arrays
        The patch's points and the centres of its faces in the undeformed mesh, length unit; after ``start``.
    """

    def __init__(
        self,
        case: str | os.PathLike[str],
        *,
        application: str = "pimpleFoam",
        environment: dict[str, str] | None = None,
        patience: float = 1800.0,
    ) -> None:
        self.case, self.application, self._patience = Path(case), application, patience
        self._environment = environment or {}
        self.points, self.faces = np.zeros((0, 3)), np.zeros((0, 3))
        self._folder = tempfile.TemporaryDirectory(prefix="mesh-motion-fsi-")
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        for option in (zmq.SNDTIMEO, zmq.RCVTIMEO):
            self._socket.setsockopt(option, round(1000 * patience))
        self._socket.bind(f"ipc://{self._folder.name}/fluid")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, done: int, windows: int, dt: float) -> None:
        """Start the solver after window ``done``; later times are deleted.

        Raises
        ------
        SetupError
            The solver is missing, or has another version of the messages.
        RecordError
            The case has no such time.
        """
        self._rewind(done, dt)
        (self.case / "system" / "windows").write_text(f"deltaT   {dt!r};\nendTime  {windows * dt!r};\n")
        if shutil.which(self.application) is None:
            raise SetupError(f"the program {self.application} was not found", "Debian: apt-get install openfoam")
        # the solver ends when this process ends, in whatever way
        leash = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []
        with (self.case / f"log.{self.application}").open("ab") as log:
            self._process = subprocess.Popen(
                [*leash, self.application], cwd=self.case, stdin=subprocess.DEVNULL, stdout=log,
                stderr=subprocess.STDOUT,
                env=os.environ | {"MESH_MOTION_FSI": f"ipc://{self._folder.name}/fluid"} | self._environment,
            )  # fmt: skip
        frames = self._receive()
        words = frames[0].decode(errors="replace").split() if frames else []
        if words[:2] != ["hello", _VERSION] or len(frames) != 3:
            raise SetupError(f"the fluid was to say hello {_VERSION}, and said {' '.join(words) or 'nothing'}")
        self.points, self.faces = (np.frombuffer(frame).reshape(-1, 3).copy() for frame in frames[1:])
        self._socket.send(b"welcome")

    def next(self) -> Request | None:
        """The next request; None when the solver has ended.

        Raises
        ------
        ParticipantError
            The solver has failed, or is silent for longer than its patience.
        """
        frames = self._receive()
        if not frames:
            return None
        words = frames[0].decode(errors="replace").split()
        if len(words) != 5 or words[0] != "window" or len(frames) != 2:
            raise ParticipantError(f"the fluid was to ask for a window, and said {' '.join(words)}")
        forces = np.frombuffer(frames[1]).reshape(-1, 3).copy()
        return Request(int(words[1]), int(words[2]), float(words[3]), float(words[4]), forces)

    def move(self, displacements: Array, *, final: bool = False) -> None:
        """Answer a request.

        Parameters
        ----------
        displacements : (p, 3) array
            Of the patch's points since the undeformed mesh, length unit.
        final : bool
            The window ends with this corrector.
        """
        if displacements.shape != self.points.shape:
            raise SetupError(f"displacements must have shape {self.points.shape}, not {displacements.shape}")
        self._socket.send_multipart([b"final" if final else b"move", np.ascontiguousarray(displacements).tobytes()])

    def refuse(self, why: str) -> None:
        """Answer a request so that the solver ends with an error."""
        self._socket.send(b"stop: " + why.encode()[:900])
        self._wait(60.0)

    def close(self) -> None:
        """End the solver if it still runs."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._socket.close()
        self._context.term()
        self._folder.cleanup()

    def __enter__(self) -> OpenFoam:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def last_words(self) -> str:
        """The reason in the solver's log why it ended: the fatal error, or the last line."""
        lines = (self.case / f"log.{self.application}").read_text(errors="replace").splitlines()
        begun = max((i for i, line in enumerate(lines) if "FOAM FATAL" in line), default=None)
        if begun is None:
            return next((line.strip() for line in reversed(lines) if line.strip()), "nothing")
        return " ".join(line.strip() for line in lines[begun + 1 : begun + 5] if line.strip())

    def _receive(self) -> list[bytes]:
        """The frames of the next message; none if the solver has ended well."""
        deadline = time.monotonic() + self._patience
        while not self._socket.poll(_POLL):
            status = self._process.poll() if self._process is not None else 0
            if status is not None and not self._socket.poll(0):
                if status == 0:
                    return []
                raise ParticipantError(self._end(status))
            if time.monotonic() > deadline:
                raise ParticipantError(f"{self.application} was silent for {self._patience:g} s")
        return list(self._socket.recv_multipart())

    def _end(self, status: int) -> str:
        """The solver's exit status or signal; after a signal its log ends with a stack, which does not help."""
        if status < 0:
            return f"{self.application} was ended by {signal.Signals(-status).name}; see {self.case}/log.*"
        return f"{self.application} ended with status {status}: {self.last_words()}"

    def _wait(self, seconds: float) -> None:
        if self._process is not None:
            try:
                self._process.wait(seconds)
            except subprocess.TimeoutExpired:
                self._process.kill()

    def _rewind(self, done: int, dt: float) -> None:
        """Delete times after window ``done``; the case then continues from ``done``, its latest time."""
        times = {path: _seconds(path.name) for path in self.case.iterdir() if path.is_dir()}
        for path, seconds in times.items():
            if seconds is not None and seconds > (done + 0.5) * dt:
                shutil.rmtree(path)
        if not any(seconds is not None and abs(seconds - done * dt) < 0.5 * dt for seconds in times.values()):
            raise RecordError(f"{self.case} has no time {done * dt:g}, with which window {done} ended")


def _seconds(name: str) -> float | None:
    """The time that a folder's name gives; None if the name is not a time."""
    try:
        return float(name)
    except ValueError:
        return None

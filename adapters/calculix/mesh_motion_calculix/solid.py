"""The solid of a coupled computation: windows that can be computed again and again until they are accepted.

``folder`` holds the data to continue a run that was killed::

    accepted.json      the number of accepted windows, the time, the deck's and the files' SHA-256
    accepted-12.rin    CalculiX' restart file of window 12
    accepted-12.dat    what it printed there
    trial-…/           the window being computed

``accepted.json`` is replaced in one piece after the files it names are on the disk: a run that is killed at any moment
continues after its last accepted window.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mesh_motion_calculix.deck import Deck, read_deck
from mesh_motion_calculix.errors import DeckError, RunError
from mesh_motion_calculix.window import JOB, Motion, Options, read_motion, run, window_deck

__all__ = ["Solid"]

#: A strip of linear bricks has two nodes at each (x, y), one in each of its planes.
_PLANES = 2


class Solid:
    """A structure in CalculiX.

    Parameters
    ----------
    deck : path
        The model: nodes, elements, materials, sections, boundary conditions, node sets; no steps.
    interface : str
        Node set where forces come in and displacements go out.
    folder : path
        Where the run keeps its files. If it has accepted windows, the run continues after them.
    dimensions : {3, 2}
        2 for plane problems: a strip of linear bricks, one element thick, whose two planes have the same x and y. The
        nodes of both planes share a force; a displacement is the mean of both planes.
    options : Options, optional
        The program, its time-out, damping, tolerance.

    Attributes
    ----------
    nodes : (k,) int64 array
        0-based node numbers of the interface (CalculiX' number less 1), ascending; in 2D those of the plane with the
        smaller z.
    points : (k, d) array
        Their coordinates in the reference, length unit.
    displacements, velocities : (k, d) arrays
        At the end of the last accepted window; displacements since the reference.
    windows : int
        How many windows were accepted.
    time : float
        Their end, time unit.

    Raises
    ------
    DeckError
        The deck cannot be read, has no such set, or the set's nodes do not form a plane problem.
    RunError
        The folder belongs to another run, was begun with another deck, or its files were changed.
    """

    def __init__(
        self,
        deck: str | os.PathLike[str],
        interface: str,
        folder: str | os.PathLike[str],
        *,
        dimensions: int = 3,
        options: Options | None = None,
    ) -> None:
        self.options = options or Options()
        self._deck = read_deck(Path(deck))
        self._interface = interface.upper()
        self._columns = _columns(self._deck, self._interface, dimensions)
        self.nodes: NDArray[np.int64] = self._columns[:, 0] - 1
        self.points = np.array([self._deck.points[int(node)][:dimensions] for node in self._columns[:, 0]])
        self.windows, self.time = 0, 0.0
        self.displacements, self.velocities = np.zeros_like(self.points), np.zeros_like(self.points)
        self._trial: tuple[Path, Motion, float] | None = None
        self._folder = Path(folder).resolve()
        self._folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(self._folder)
        try:
            self._drop_trials()
            self._resume()
        except BaseException:
            self.close()
            raise

    def solve(self, forces: ArrayLike, dt: float) -> NDArray[np.float64]:
        """Compute the next window from the last accepted one; this may be repeated any number of times.

        Parameters
        ----------
        forces : (k, d) array
            Nodal forces at the window's end, force unit; in 2D those on the strip's whole thickness.
        dt : float
            Length of the window, time unit.

        Returns
        -------
        (k, d) array
            Displacements since the reference at the window's end, to the seven digits that CalculiX prints.

        Raises
        ------
        DeckError
            Wrong shape, a value that is not finite, or a deck that ccx refuses.
        DivergedError
            The window was not solved. The accepted state does not change.
        RunError
            ccx is missing, took too long, or died.
        """
        loads = self._loads(forces)
        if not (np.isfinite(dt) and dt > 0.0):
            raise DeckError(f"the window's length must be positive, not {dt!r}")
        self._drop_trials()
        folder = Path(tempfile.mkdtemp(prefix="trial-", dir=self._folder))
        if self.windows:
            shutil.copyfile(self._accepted("rin", self.windows), folder / f"{JOB}.rin")
        model = None if self.windows else self._deck.lines
        (folder / f"{JOB}.inp").write_text(window_deck(model, self._interface, loads, dt, self.options))
        run(folder, self.options)
        motion = self._read(folder / f"{JOB}.dat")
        self._trial = folder, motion, float(dt)
        return motion.displacements.copy()

    def advance(self) -> None:
        """Accept the last computed window: the next one starts from its end.

        Raises
        ------
        RunError
            No window was computed since the last one accepted, or the folder cannot be written.
        """
        if self._trial is None:
            raise RunError("there is no window to accept", "call solve first; one that failed cannot be accepted")
        folder, motion, dt = self._trial
        number, time = self.windows + 1, self.time + dt
        try:
            names = {"rin": folder / f"{JOB}.rout", "dat": folder / f"{JOB}.dat"}
            digests = {kind: self._keep(path, self._accepted(kind, number)) for kind, path in names.items()}
            self._write_state({"windows": number, "time": time, "deck": self._digest(), "sha256": digests})
        except OSError as error:
            raise RunError(f"window {number} cannot be kept: {error}") from None
        for kind in names:
            self._accepted(kind, self.windows).unlink(missing_ok=True)
        self.windows, self.time = number, time
        self.displacements, self.velocities = motion.displacements, motion.velocities
        self._drop_trials()

    def close(self) -> None:
        """Release the folder; another run may continue with it."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> Solid:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _loads(self, forces: ArrayLike) -> list[tuple[int, NDArray[np.float64]]]:
        """Node numbers, each with its share of the force of its column."""
        values = np.asarray(forces, dtype=np.float64)
        if values.shape != self.points.shape:
            raise DeckError(f"forces must have shape {self.points.shape}, not {values.shape}")
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise DeckError(f"the force of row {row} is not finite: {values[row].tolist()}")
        shares = values / self._columns.shape[1]
        shares[np.abs(shares) < 1e-99] = 0.0  # an exponent of three digits is no number worth a Fortran field
        return [(int(node), share) for nodes, share in zip(self._columns, shares, strict=True) for node in nodes]

    def _read(self, path: Path) -> Motion:
        """The interface's motion as (k, d) arrays: means over the columns."""
        motion = read_motion(path, self._columns.ravel())
        shape = (*self._columns.shape, 3)
        dimensions = self.points.shape[1]
        return Motion(
            motion.displacements.reshape(shape).mean(axis=1)[:, :dimensions],
            motion.velocities.reshape(shape).mean(axis=1)[:, :dimensions],
        )

    def _accepted(self, kind: str, number: int) -> Path:
        return self._folder / f"accepted-{number}.{kind}"

    def _digest(self) -> str:
        """SHA-256 of the interface's name and the deck's lines, which must not change between windows."""
        return hashlib.sha256("\n".join((self._interface, *self._deck.lines)).encode()).hexdigest()

    def _keep(self, source: Path, target: Path) -> str:
        """Move a file to its place once it is on the disk; return its SHA-256."""
        with source.open("rb") as file:
            digest = hashlib.sha256(file.read()).hexdigest()
            os.fsync(file.fileno())
        source.replace(target)
        return digest

    def _write_state(self, state: dict[str, object]) -> None:
        """Replace accepted.json in one piece, when it and all files that it names are on the disk."""
        fresh = self._folder / "accepted.json.new"
        with fresh.open("w") as file:
            json.dump(state, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        _sync(self._folder)
        fresh.replace(self._folder / "accepted.json")
        _sync(self._folder)

    def _resume(self) -> None:
        """Read the last accepted window, if any."""
        path = self._folder / "accepted.json"
        if not path.exists():
            return
        try:
            state = json.loads(path.read_text())
            number, time, deck = int(state["windows"]), float(state["time"]), state["deck"]
            files = {kind: self._accepted(kind, number) for kind in ("rin", "dat")}
            digests = {kind: hashlib.sha256(path.read_bytes()).hexdigest() for kind, path in files.items()}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise RunError(f"{path} cannot be continued: {error!r}", "start in an empty folder") from None
        if deck != self._digest():
            raise RunError(f"{self._folder} was begun with another deck or set", "start in an empty folder")
        if digests != state.get("sha256"):
            raise RunError(f"files of window {number} in {self._folder} were changed", "start in an empty folder")
        for left in {*self._folder.glob("accepted-*")} - {*files.values()}:
            left.unlink()
        motion = self._read(self._accepted("dat", number))
        self.windows, self.time = number, time
        self.displacements, self.velocities = motion.displacements, motion.velocities

    def _drop_trials(self) -> None:
        """Delete the last computed window, and the files that killed runs left."""
        self._trial = None
        for left in self._folder.glob("trial-*"):
            shutil.rmtree(left, ignore_errors=True)


def _columns(deck: Deck, interface: str, dimensions: int) -> NDArray[np.int64]:
    """Node numbers of the interface, (k, 1), or in 2D (k, 2): the two nodes of a strip that share x and y."""
    nodes = deck.node_set(interface)
    if dimensions == 3:
        return nodes[:, None]
    if dimensions != 2:
        raise DeckError(f"dimensions must be 2 or 3, not {dimensions}")
    columns: dict[tuple[float, float], list[int]] = {}
    points = np.array([deck.points[int(node)] for node in nodes])
    grain = max(float(np.ptp(points, axis=0).max()), 1e-300) * 1e-9
    for node, (x, y, _) in zip(nodes, np.round(points / grain), strict=True):
        columns.setdefault((x, y), []).append(int(node))
    odd = [column[0] for column in columns.values() if len(column) != _PLANES]
    if odd:
        message = f"set {interface} is no strip's: there are not two nodes at the (x, y) of node {odd[0]}"
        raise DeckError(message, "a strip of linear bricks (C3D8I) with both its planes; dimensions=3 takes any set")
    ordered = [sorted(column, key=lambda node: float(deck.points[node][2])) for column in columns.values()]
    return np.array(sorted(ordered), dtype=np.int64)


def _locked(folder: Path) -> int:
    """A descriptor that holds the folder's lock."""
    descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise RunError(f"{folder} is used by another run", "one folder, one run") from None
    return descriptor


def _sync(folder: Path) -> None:
    """Sync a folder's entries to the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

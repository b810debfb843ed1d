"""The coupled computation: windows, each iterated until fluid and solid agree at their interface.

In a window the fluid moves the interface to x (displacements at the solid's nodes, mapped to its points) and answers
with forces, which the solid answers with displacements H(x). If x and H(x) agree, H(x) is given to the fluid a last
time, and both solvers go on. Otherwise an acceleration chooses the next x. The first x of a window is the linear
extrapolation from the last two windows.

The folder of a run::

    history.csv          a row for each window
    solid/               the solid's accepted windows: a killed run continues after the last one
    coupling-12.npz      the other data that a later run needs to continue after window 12
"""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_fsi.acceleration import Acceleration
from mesh_motion_fsi.errors import NotConvergedError, RecordError, SetupError
from mesh_motion_fsi.fluid import Request
from mesh_motion_fsi.mapping import Mapping

__all__ = ["Coupling", "Fluid", "Row", "Settings", "Solid", "read_history"]

Array = NDArray[np.float64]


class Fluid(Protocol):
    """The methods that a fluid needs for the coupling; ``OpenFoam`` is one."""

    points: Array
    faces: Array

    def start(self, done: int, windows: int, dt: float) -> None:
        """Prepare to begin the window after ``done``."""

    def next(self) -> Request | None:
        """Wait for the next request."""

    def move(self, displacements: Array, *, final: bool = False) -> None:
        """Answer it."""

    def refuse(self, why: str) -> None:
        """End the fluid."""


class Solid(Protocol):
    """The methods that a solid needs for the coupling; ``mesh_motion_calculix.Solid`` is one."""

    points: Array
    displacements: Array
    windows: int

    def solve(self, forces: Array, dt: float) -> Array:
        """Compute the next window; this may be repeated any number of times."""

    def advance(self) -> None:
        """Accept what was computed last."""


@dataclass(frozen=True)
class Settings:
    """How the windows are coupled.

    Attributes
    ----------
    windows : int
        How many there are.
    dt : float
        Their length, time unit.
    tolerance : float
        A window has converged where the residual's norm is at most this share of the displacements' norm …
    noise : float
        … or at most this root mean square, length unit: the resolution of the solid's printed digits.
    most_iterations : int
        More are an error. The fluid must allow two iterations more.
    thickness : float
        Forces on the fluid's mesh are multiplied by this: the solid's thickness over the fluid mesh's, in 2D.
    watch : tuple of float
        The history has the motion of the solid's node that is nearest to this reference position.
    """

    windows: int
    dt: float
    tolerance: float = 1e-3
    noise: float = 1e-7
    most_iterations: int = 50
    thickness: float = 1.0
    watch: tuple[float, ...] = (0.0, 1.0)


@dataclass(frozen=True)
class Row:
    """One window of the history: the watched node's displacement, the sum of the forces, the cost."""

    window: int
    time: float
    x: float
    y: float
    force_x: float
    force_y: float
    iterations: int
    residual: float
    seconds: float


class Coupling:
    """A fluid and a solid that share an interface.

    Parameters
    ----------
    fluid, solid : Fluid, Solid
        The participants.
    acceleration : Acceleration
        A new one that has not been used.
    folder : path
        Folder of the run. If it has windows, the run continues.
    """

    def __init__(
        self,
        fluid: Fluid,
        solid: Solid,
        acceleration: Acceleration,
        settings: Settings,
        folder: str | os.PathLike[str],
    ) -> None:
        self._fluid, self._solid, self._acceleration, self._settings = fluid, solid, acceleration, settings
        self._folder = Path(folder)
        self._before = solid.displacements.copy()
        offsets = np.linalg.norm(solid.points - np.array(settings.watch), axis=1)
        self._watched = int(offsets.argmin())

    def run(self, report: Callable[[Row], None] | None = None) -> list[Row]:
        """Compute all windows that are not yet accepted.

        Parameters
        ----------
        report : callable, optional
            Takes each window's row.

        Returns
        -------
        list of Row
            The whole history, with the windows of earlier runs.

        Raises
        ------
        FsiError
            As its classes say; the accepted windows stay.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        self._resume()
        rows = [row for row in read_history(self._folder) if row.window <= self._solid.windows]
        if self._solid.windows >= self._settings.windows:
            return rows
        self._fluid.start(self._solid.windows, self._settings.windows, self._settings.dt)
        d = self._solid.points.shape[1]
        self._to_points = Mapping(self._solid.points, self._fluid.points[:, :d])
        self._to_faces = Mapping(self._solid.points, self._fluid.faces[:, :d])
        with (self._folder / "history.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, [field.name for field in fields(Row)])
            writer.writeheader()
            writer.writerows(map(asdict, rows))
            for row in self._windows():
                writer.writerow(asdict(row))
                file.flush()
                rows.append(row)
                if report is not None:
                    report(row)
        return rows

    def _windows(self) -> Iterator[Row]:
        """Yield each window after the fluid has written it."""
        request = self._fluid.next()
        while request is not None:
            self._check(request)
            began = time.monotonic()
            last, iterations, residual = self._window()
            # the fluid sends its next request, or ends, after it has written its window; then the solid accepts its
            # window too
            request = self._fluid.next()
            if request is not None and request.iteration != 1:
                raise SetupError("the fluid goes on in a window that has ended", "nOuterCorrectors in fvSolution")
            previous = self._solid.displacements.copy()
            self._save(self._solid.windows + 1, previous)
            self._solid.advance()
            self._before = previous
            self._drop()
            tip = self._solid.displacements[self._watched]
            force = last.forces.sum(axis=0) * self._settings.thickness
            yield Row(
                last.window, round(last.time, 12), float(tip[0]), float(tip[1]), float(force[0]), float(force[1]),
                iterations, residual, round(time.monotonic() - began, 3),
            )  # fmt: skip

    def _window(self) -> tuple[Request, int, float]:
        """Iterate one window: the last request, the iterations, the residual."""
        x = 2.0 * self._solid.displacements - self._before
        window, residual = self._solid.windows + 1, np.inf
        for iteration in range(1, self._settings.most_iterations + 1):
            self._move(x)
            request = self._fluid.next()
            if request is None or request.iteration != iteration + 1:
                raise SetupError("the fluid ended the window by itself", "more nOuterCorrectors in fvSolution")
            loads = self._to_faces.loads(request.forces)[:, : x.shape[1]] * self._settings.thickness
            answer = self._solid.solve(loads, self._settings.dt)
            change = float(np.linalg.norm(answer - x))
            residual = change / max(float(np.linalg.norm(answer)), np.finfo(float).tiny)
            if residual <= self._settings.tolerance or change <= self._settings.noise * np.sqrt(x.size):
                self._move(answer, final=True)
                self._acceleration.end_window()
                return request, iteration, residual
            x = self._acceleration.next(x.ravel(), answer.ravel()).reshape(x.shape)
        most = self._settings.most_iterations
        why = f"window {window} did not converge: residual {residual:.3g} after {most} iterations"
        self._fluid.refuse(why)
        raise NotConvergedError(why, "a smaller dt, another acceleration or more iterations")

    def _move(self, x: Array, *, final: bool = False) -> None:
        """Give displacements at the solid's nodes to the fluid."""
        displacements = np.zeros_like(self._fluid.points)
        displacements[:, : x.shape[1]] = self._to_points.displacements(x)
        self._fluid.move(displacements, final=final)

    def _check(self, request: Request) -> None:
        """Check that the fluid begins the same window as the solid."""
        if request.window != self._solid.windows + 1 or not np.isclose(request.dt, self._settings.dt):
            ours = f"window {self._solid.windows + 1} of {self._settings.dt:g}"
            raise SetupError(f"the fluid begins window {request.window} of {request.dt:g}, the solid {ours}")

    def _save(self, window: int, before: Array) -> None:
        """Write the data that the solid does not keep, in one piece, before the solid accepts the window."""
        path = self._folder / f"coupling-{window}.npz"
        with path.with_suffix(".new").open("wb") as file:
            np.savez(file, before=before, **self._acceleration.state())  # type: ignore[arg-type]  # none is named as an argument
            file.flush()
            os.fsync(file.fileno())
        path.with_suffix(".new").replace(path)

    def _drop(self) -> None:
        """Delete the records of other windows."""
        for path in self._folder.glob("coupling-*"):
            if path.name != f"coupling-{self._solid.windows}.npz":
                path.unlink()

    def _resume(self) -> None:
        """Read the data of the solid's last accepted window."""
        if self._solid.windows == 0:
            return
        path = self._folder / f"coupling-{self._solid.windows}.npz"
        try:
            with np.load(path, allow_pickle=False) as record:
                state = {name: record[name] for name in record.files}
            self._before = state.pop("before")
            self._acceleration.restore(state)
        except (OSError, ValueError, KeyError) as error:
            raise RecordError(f"{path} cannot be continued: {error!r}", "start in an empty folder") from None


def read_history(folder: str | os.PathLike[str]) -> list[Row]:
    """The rows of a run's history.csv; empty without the file. A last row that was cut off is left out."""
    path = Path(folder) / "history.csv"
    if not path.exists():
        return []
    kinds = {field.name: int if field.type == "int" else float for field in fields(Row)}
    with path.open(newline="") as file:
        whole = [row for row in csv.DictReader(file) if None not in row.values()]
    return [Row(**{name: kinds[name](value) for name, value in row.items()}) for row in whole]  # type: ignore[arg-type]

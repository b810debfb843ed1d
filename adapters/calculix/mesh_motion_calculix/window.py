"""One time window: the deck that CalculiX reads, the run, and the printed motion of the interface.

A window is one step of one increment, ``*DYNAMIC, DIRECT`` with geometric nonlinearity (Hilber, Hughes and Taylor's
method). The first window reads the model, each later one the restart file of the window before it. The nodal forces
apply at the window's end; within the window they change linearly from those of the previous window.
"""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_calculix.errors import CalculixError, DeckError, DivergedError, RunError

__all__ = ["JOB", "Motion", "Options", "read_motion", "run", "window_deck"]

#: The name of ccx' files; ccx reads JOB.inp and JOB.rin and writes JOB.dat and JOB.rout.
JOB = "window"
#: CalculiX reads fields of 20 characters: a sign, 13 digits, a three-digit exponent.
_NUMBER = "{:.12e}"
_DIVERGED = re.compile(
    r"diverge|no convergence|cutback|increment size smaller|too many iterations|jacobian", re.IGNORECASE
)
#: For ccx this is only a warning: it leaves the card out and computes another model.
_UNKNOWN_CARD = re.compile(r"Card image cannot be inter\s*preted:\s*\*WARNING[^\n]*\n\s*(\S[^\n]*)")
_LOST_EXPONENT = re.compile(r"(\d)([+-]\d{3})")
#: Widths of the columns that ccx prints for *NODE PRINT.
_DIGITS_OF_NODE = 10
_DIGITS_OF_VALUE = 14


@dataclass(frozen=True)
class Options:
    """How each window is computed.

    Attributes
    ----------
    executable : str
        The program, a name or a path.
    threads : int
        Threads of ccx. One gives the same bytes every time.
    timeout : float
        Seconds that one window may take.
    alpha : float
        Numerical damping of the time integration, -1/3 (most) to 0 (none; the energy of a free vibration stays).
    tolerance : float
        Largest residual force and correction relative to their averages at which ccx ends its iterations. CalculiX'
        default, 5e-3, is too coarse for a coupling that compares iterations.
    step_cards : tuple of str
        Further lines for each step, for example ``("*DLOAD", "EALL, GRAV, 9.81, 0., -1., 0.")``.
    """

    executable: str = "ccx"
    threads: int = 1
    timeout: float = 600.0
    alpha: float = 0.0
    tolerance: float = 1e-6
    step_cards: tuple[str, ...] = ()


@dataclass(frozen=True)
class Motion:
    """The printed motion: displacements since the reference and velocities, (k, 3) arrays in the order of the nodes."""

    displacements: NDArray[np.float64]
    velocities: NDArray[np.float64]


def window_deck(
    model: tuple[str, ...] | None,
    interface: str,
    loads: list[tuple[int, NDArray[np.float64]]],
    dt: float,
    options: Options,
) -> str:
    """The deck of one window.

    Parameters
    ----------
    model : tuple of str or None
        The model's lines for the first window, None for one that starts from a restart file.
    interface : str
        Name of the node set whose motion is printed.
    loads : list of (int, (d,) array)
        Node numbers and forces, force unit. Zero forces must be included: a load stays until another one replaces it.
    dt : float
        Length of the window, time unit.
    """
    tolerance = _NUMBER.format(options.tolerance)
    time = _NUMBER.format(dt)
    forces = [
        f"{node}, {axis}, {_NUMBER.format(value)}" for node, force in loads for axis, value in enumerate(force, start=1)
    ]
    lines = [
        *(model if model is not None else ("*RESTART, READ",)),
        "*STEP, NLGEOM, INC=1, AMPLITUDE=RAMP",
        f"*DYNAMIC, DIRECT, ALPHA={options.alpha!r}",
        f"{time}, {time}",
        "*CONTROLS, PARAMETERS=FIELD",
        f"{tolerance}, {tolerance}",
        "*CLOAD",
        *forces,
        *options.step_cards,
        f"*NODE PRINT, NSET={interface}",
        "U, V",
        "*RESTART, WRITE, FREQUENCY=1",
        "*END STEP",
    ]
    return "\n".join(lines) + "\n"


def run(folder: Path, options: Options) -> None:
    """Run ccx on JOB.inp in ``folder``.

    Raises
    ------
    RunError
        The program is missing, takes longer than the time-out, or dies.
    DivergedError
        The equations were not solved.
    DeckError
        ccx refuses the deck; the message has its first error.
    """
    log = folder / "ccx.log"
    try:
        with log.open("wb") as out:
            done = subprocess.run(
                [options.executable, JOB], cwd=folder, env=os.environ | {"OMP_NUM_THREADS": str(options.threads)},
                stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, timeout=options.timeout, check=False,
            )  # fmt: skip
    except FileNotFoundError:
        hint = "Debian: apt-get install calculix-ccx; or name it with Options(executable=...)"
        raise RunError(f"the program {options.executable} was not found", hint) from None
    except OSError as error:
        raise RunError(f"the program {options.executable} cannot be run: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        hint = "Options(timeout=...) allows more"
        raise RunError(f"ccx did not end within {options.timeout:g} s and was stopped; see {log}", hint) from None
    failure = _failure(log.read_text(errors="replace"), done.returncode, log)
    if failure is not None:
        raise failure


def _failure(output: str, status: int, log: Path) -> CalculixError | None:
    """The error in a run's output and exit status; None for a run without one."""
    ignored = _UNKNOWN_CARD.search(output)
    if ignored:
        return DeckError(f"ccx does not know the card {ignored[1].strip()}", f"all of it: {log}")
    if status == 0 and "*ERROR" not in output and "Job finished" in output:
        return None
    said = _first_error(output)
    if _DIVERGED.search(said):
        return DivergedError(f"ccx did not solve the window: {said}", "a smaller load or a smaller window may help")
    if said:
        return DeckError(f"ccx says: {said}", f"all of it: {log}")
    return RunError(f"ccx ended with status {status} before its job was finished", f"its output: {log}")


def _first_error(output: str) -> str:
    """ccx' first error with its continuation lines, as one line; empty if there is no error."""
    lines = iter(output.splitlines())
    for line in lines:
        if "*ERROR" in line:
            said = [line.strip()]
            for more in lines:
                if not more.strip() or more.lstrip().startswith("*"):
                    break
                said.append(more.strip())
            return " ".join(said)
    return ""


def read_motion(path: Path, nodes: NDArray[np.int64]) -> Motion:
    """Read what ccx printed for the interface.

    Parameters
    ----------
    path : Path
        ccx' file of results, JOB.dat.
    nodes : (k,) int64 array
        Node numbers in the order wanted.

    Raises
    ------
    DivergedError
        A value is not finite.
    RunError
        The file is missing, cut off, or has other nodes.
    """
    try:
        blocks = _blocks(path.read_text())
        found = [np.array([blocks[name][int(node)] for node in nodes]) for name in ("displacements", "velocities")]
    except (OSError, KeyError, ValueError) as error:
        raise RunError(f"{path} does not have the motion of every node of the interface: {error!r}") from None
    for values in found:
        if not np.isfinite(values).all():
            node = int(nodes[np.argmin(np.isfinite(values).all(axis=1))])
            raise DivergedError(f"the motion of node {node} is not finite", "a smaller load or window may help")
    return Motion(*found)


def _blocks(text: str) -> dict[str, dict[int, list[float]]]:
    """Rows by node of each printed quantity; the last block of a quantity counts."""
    blocks: dict[str, dict[int, list[float]]] = {}
    rows: dict[int, list[float]] = {}
    for line in text.splitlines():
        if not line.strip():
            continue
        if line.lstrip()[0].isalpha():
            rows = blocks[line.split()[0]] = {}
        else:
            rows[int(line[:_DIGITS_OF_NODE])] = [_value(line, column) for column in range(3)]
    return blocks


def _value(line: str, column: int) -> float:
    """One number of a row in columns; Fortran omits the E if the exponent has three digits."""
    start = _DIGITS_OF_NODE + column * _DIGITS_OF_VALUE
    return float(_LOST_EXPONENT.sub(r"\1E\2", line[start : start + _DIGITS_OF_VALUE]))

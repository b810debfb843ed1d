"""The results of a run: ``summary.json``, ``points.npy`` (final coordinates, the file's node order), ``steps.csv``,
``mesh.pvd`` with ``mesh_0000.vtu``, … and ``quality.png``.

A refused case leaves the results of the steps before, with ``accepted.npy`` (the last accepted coordinates) in place of
``points.npy``, and ``refused.vtu``; a case that never began has no results. Results of an earlier run are removed
first, so a folder only has results of the last case.
"""

import csv
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import ResourceExhausted

from mesh_motion_server.cases.faces import FACES
from mesh_motion_server.cases.records import StepRecord
from mesh_motion_server.session.history.events import finite

SERIES = "mesh"
#: Patterns of the files that a run writes.
RESULTS = (
    "summary.json",
    "points.npy",
    "accepted.npy",
    "refused.vtu",
    "steps.csv",
    f"{SERIES}.pvd",
    f"{SERIES}_[0-9]*.vtu",
    "quality.png",
    "comparison.json",
)


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Make a folder that receives results during the block; it is removed if an error leaves nothing to keep.

    Raises ResourceExhausted if the folder cannot be made or written.
    """
    made = not folder.exists()
    remove_results(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from None
    try:
        yield
    except BaseException:
        if not (folder / "summary.json").exists():
            remove_results(folder)
            if made:
                _remove_if_empty(folder)
        raise


def remove_results(folder: Path) -> None:
    """Remove the results of an earlier run, and nothing else.

    Raises ResourceExhausted if the folder cannot be written.
    """
    try:
        for pattern in RESULTS:
            for file in folder.glob(pattern):
                file.unlink()
    except OSError as error:
        raise _unwritable(folder, error) from None


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write summary.json; NaN and infinity become null, because JSON does not have them."""
    text = json.dumps(finite(summary), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def write_points(folder: Path, points: Floats, name: str = "points.npy") -> None:
    """Write points.npy, or ``name``."""
    np.save(folder / name, points, allow_pickle=False)


def write_steps(folder: Path, steps: Sequence[StepRecord]) -> None:
    """Write steps.csv."""
    with (folder / "steps.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, (*StepRecord.columns(), *FACES))
        writer.writeheader()
        writer.writerows(step.as_row() for step in steps)


def _unwritable(folder: Path, error: OSError) -> ResourceExhausted:
    return ResourceExhausted(f"{folder}: results cannot be written there: {error.strerror or error}")


def _remove_if_empty(folder: Path) -> None:
    """Remove the folder if it is empty."""
    if not any(folder.iterdir()):
        folder.rmdir()

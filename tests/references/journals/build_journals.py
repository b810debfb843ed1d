"""Writes the golden journals: ``python tests/references/journals/build_journals.py [LEVEL …]``.

``<format>/<level>.zip`` holds the folder of one session after this version of the server was killed, and
``expected.json``, the expected data after a RESUME. From the first release on, a journal in this folder is never
written again: every later version must open it. Until then they are written again when a key is removed. When the
format changes, raise its number (``records.py``, ``spec.py``, ``mesh_store.py``), add it to :data:`FORMATS` below, and
add the output of this script to the old files.

The session: 16 nodes, five steps; after the second one another holder raises the epoch and drops a trial; a last trial
is lost. With "replay" the third state is stored. With "relaxed" the fourth state is not stored.
"""

from __future__ import annotations

import io
import json
import sys
import tempfile
import threading
import time
import zipfile
from math import fsum
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from mesh_motion_numerics.quality.quality_summary import Distribution, QualitySummary
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import Commit, Fetch, Join, Move

from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session import replay
from mesh_motion_server.session.journal import journal as journal_module
from mesh_motion_server.session.journal.records import PAGE
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from tests.faults.driver import SESSION, TOKEN, Driver
from tests.faults.stand_in import StandIn, grid_mesh

HERE = Path(__file__).parent
#: Level → the format that this version writes.
FORMATS = {"full": 1, "replay": 2, "relaxed": 2}
STEPS = 5
FILES = ("spec.json", "mesh.bin", "manifest", "slot-0", "slot-1")


class ExactModel(StandIn):
    """Sums that are rounded once: the same bits on every processor and with every library."""

    def summary(self, points: Any) -> QualitySummary:
        areas = [float(area) for area in self._areas(points)]
        values = Distribution(min(areas), fsum(areas) / len(areas), min(areas), min(areas), max(areas))
        return QualitySummary(values, values, values, values, 0, len(areas), ())

    def move(self, committed: Any, targets: Any, factors: Any, *, boundary_displacement: Any = None) -> Any:
        moving, points = self.roles.moving, committed.copy()
        displacement = targets - committed[moving]
        for axis in range(committed.shape[1]):
            mean = fsum(float(x) for x in displacement[:, axis]) / len(displacement)
            for node in range(len(committed)):
                points[node, axis] = float(committed[node, axis]) + mean * (1.0 - float(self.points[node, 0]))
        points[moving] = targets
        points[self.roles.fixed] = committed[self.roles.fixed]
        summary = self.summary(points)
        return SimpleNamespace(
            points=points, standard=summary, corrected=summary, reached=True, seconds={"total": 0.0}, caches={},
            correction=SimpleNamespace(
                method="none", enrichment_points=np.zeros((0, 2)), freed_nodes=0, iterations=0
            ),
            control_points=moving, support_radius=1.0, sub_steps=1, warnings=[], field=None,
        )  # fmt: skip


MODEL: Any = ExactModel


def displacement(driver: Driver, step: int) -> list[Any]:
    """Displacement of the left side: exact in binary, and different in every step."""
    rows = np.array([[step / 128 + node / 1024, (-1) ** step / 64] for node in range(len(driver.moving[0]))])
    return [rows]


def build(level: str, root: Path) -> dict[str, Any]:
    """Run a session in a state folder and kill it there; return its expected data."""
    journal_module.manifest_capacity = lambda foundation: 12 * PAGE
    host = SessionHost.create(_spec(level), SessionStore(root), build_model=MODEL, **_limits(level))
    driver = Driver(host, [grid_mesh(4)])
    driver.open()
    with _pinned(level) as gate:
        replies = _live(driver, gate)
    end(host)
    return {"level": level, "step": STEPS, "epoch": 2, **replies, **taken_up(root)[1]}


def end(host: Any) -> None:
    session = host._session
    session.close() if session.spec.durability == "full" else session.close(keep=False)


def taken_up(root: Path) -> tuple[Any, dict[str, Any]]:
    copy = Path(tempfile.mkdtemp(prefix="journal-"))
    folder = copy / "sessions" / SESSION
    folder.mkdir(parents=True)
    for name in FILES:
        (folder / name).write_bytes((root / "sessions" / SESSION / name).read_bytes())
    host = SessionHost.resume(SESSION, TOKEN, SessionStore(copy), build_model=MODEL)
    driver = Driver(host, [grid_mesh(4)])
    driver.sequences = [1000]
    driver.ask(Join, token=TOKEN)
    points = driver.ask(Fetch).points
    (moved,) = driver.all(_move(driver, STEPS + 1))
    said = {"points": points.tobytes().hex(), "next_displacement": moved.displacement.tobytes().hex()}
    return driver, said


def requests(driver: Driver, step: int) -> Any:
    """The COMMIT of a step, as it was first sent."""
    return driver.request(Commit, client=b"golden committer"[:16], sequence=step, step=step)


def _move(driver: Driver, step: int) -> Any:
    def make(**fields: Any) -> Any:
        return Move(**fields, step=step, frame="committed", displacement=displacement(driver, step)[0])

    return make


def _live(driver: Driver, gate: Any) -> dict[str, Any]:
    """Five steps; the frames of the replies to their commits, and the digests."""
    replies, digests = {}, {}
    for step in range(1, STEPS + 1):
        driver.all(_move(driver, step))
        if step == 3:
            driver.host.reclaim(TOKEN)
            driver.join()
            driver.all(_move(driver, step))
        gate.before(driver, step)
        (reply,) = driver.send(requests(driver, step))
        gate.after(driver, step)
        replies[step] = b"".join(bytes(frame) for frame in encode(reply)).hex()
        digests[step] = reply.digest.hex()
    driver.all(_move(driver, STEPS + 1))
    gate.end(driver)
    return {"replies": replies, "digests": digests}


class _pinned:
    """Fix everything that could vary: the version that computed, and the batches in which a relaxed session stores."""

    def __init__(self, level: str) -> None:
        self.level, self.open = level, threading.Event()
        self.open.set()

    def __enter__(self) -> _pinned:
        if self.level == "replay":
            self._restore = (replay, "maker", replay.maker)
            replay.maker = lambda: "the builder of the golden journals"  # type: ignore[assignment]
        elif self.level == "relaxed":
            honest, event = journal_module.Journal.store, self.open

            def store(journal: Any, *given: Any) -> None:
                event.wait()
                honest(journal, *given)

            self._restore = (journal_module.Journal, "store", honest)
            journal_module.Journal.store = store  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        if self.level != "full":
            setattr(*self._restore)

    def before(self, driver: Driver, step: int) -> None:
        """The third state is being written while the next two come."""
        if step == 3:
            self.open.clear()

    def after(self, driver: Driver, step: int) -> None:
        keeper = getattr(driver.host._session._built, "keeper", None)
        if self.level == "relaxed" and step == 3:
            while not keeper._storing:
                time.sleep(1e-3)
        elif self.level == "relaxed" and step < 3:
            keeper.catch_up()

    def end(self, driver: Driver) -> None:
        self.open.set()
        if self.level == "relaxed":
            driver.host._session.catch_up()


def _spec(level: str) -> SessionSpec:
    settings = MethodSettings(quality_metric="size-skew")  # the default when these journals were written
    return SessionSpec(session=SESSION, token=TOKEN, dimension=2, label="golden", durability=level, settings=settings)


def _limits(level: str) -> dict[str, Any]:
    return {} if level == "full" else {"limits": ServerSettings(snapshot_steps=3)}


def packed(files: dict[str, bytes]) -> bytes:
    """A zip file of these contents, the same bytes for the same contents."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def main(levels: list[str]) -> None:
    for level in levels or FORMATS:
        target = HERE / str(FORMATS[level]) / f"{level}.zip"
        if target.exists():
            sys.exit(f"{target} is there: golden journals are added, not written again")
        with tempfile.TemporaryDirectory() as root:
            expected = json.dumps(build(level, Path(root)), indent=1).encode()
            folder = Path(root) / "sessions" / SESSION
            files = {name: (folder / name).read_bytes() for name in FILES}
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(packed(files | {"expected.json": expected}))


if __name__ == "__main__":
    main(sys.argv[1:])

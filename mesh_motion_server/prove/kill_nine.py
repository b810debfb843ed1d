"""SIGKILL of a process that commits, at random moments of opening, recovering and committing.

Every reply that came out, also those asked for once more after a kill, and the coordinates at the end must be bitwise
those of a process that nobody disturbed, which commits the same steps on the model file system. The kernel survives, so
this does not show that anything was synced: that is what the power-loss check is for.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import numpy as np

from mesh_motion_server.prove.check import BrokenPromise, Budget, Check, Result, require
from mesh_motion_server.prove.driver import make_driver
from mesh_motion_server.prove.killed_process import final_points, open_session, run_to
from mesh_motion_server.prove.model_files import ModelFiles
from mesh_motion_server.prove.stand_in import grid_mesh
from mesh_motion_server.session.store import SessionStore

__all__ = ["CHECK", "Witness", "kill_again_and_again"]

#: A life lasts up to so many seconds: some tens of commits, or not even its recovery. On a machine so busy that no step
#: is reached, each life may last as much longer than the one before.
_LONGEST = 0.2
#: Threads that a fork leaves as they are: GNU's OpenMP ends a process that is forked after its first use.
_FORKABLE = {"NUMBA_THREADING_LAYER": "workqueue", "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
#: What a recovery may take at the 95th percentile.
_RECOVERY_SECONDS = 2.0


@dataclass
class Witness:
    """What the killed processes said.

    Attributes
    ----------
    replies : dict
        The COMMITTED frame of each acknowledged step.
    recoveries : list of float
        Seconds from fork to an open session.
    repeats : int
        Replies that came again after a kill.
    lives : int
    """

    replies: dict[int, bytes] = field(default_factory=dict)
    recoveries: list[float] = field(default_factory=list)
    repeats: int = 0
    lives: int = 0

    @property
    def last(self) -> int:
        """The last acknowledged step."""
        return max(self.replies, default=0)

    def hear(self, lines: Iterable[str]) -> None:
        """The lines of one life.

        Raises
        ------
        BrokenPromise
            If an acknowledged step is lost or a repeated reply differs.
        """
        self.lives += 1
        for line in lines:
            word, _, rest = line.partition(" ")
            if word == "resumed":
                self._resumed(rest)
            elif word == "reply":
                self._replied(rest)
            else:
                raise BrokenPromise(f"life {self.lives}: {line}")

    def _resumed(self, rest: str) -> None:
        step, seconds = rest.split()
        require(
            int(step) in (self.last, self.last + 1),
            f"life {self.lives} resumes at step {step}, {self.last} was acknowledged",
        )
        if self.lives > 1:
            self.recoveries.append(float(seconds))

    def _replied(self, rest: str) -> None:
        step, frame = int(rest.split(maxsplit=1)[0]), bytes.fromhex(rest.split()[1])
        known = self.replies.setdefault(step, frame)
        require(known == frame, f"the repeated reply of step {step} differs in life {self.lives}")
        self.repeats += known is not frame


def kill_again_and_again(folder: Path, random: Random, budget: Budget) -> Witness:
    """So many lives of a session in a folder.

    Raises
    ------
    BrokenPromise
        As :meth:`Witness.hear`, or if a process ended by itself.
    """
    witness = Witness()
    command = [sys.executable, "-m", "mesh_motion_server.prove.killed_process", str(folder)]
    environment = os.environ | _FORKABLE
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        idle = 0
        while budget.admits(witness.lives):
            process.stdin.write(f"{random.uniform(0, _LONGEST * (1 + idle)):.6f}\n")
            process.stdin.flush()
            former = witness.last
            witness.hear(_one_life(process.stdout))
            idle = idle + 1 if witness.last == former else 0
        process.stdin.close()
    return witness


def _one_life(output: Iterable[str]) -> list[str]:
    """Lines up to the kill."""
    lines: list[str] = []
    for line in output:
        if line == "killed\n":
            return lines
        lines.append(line.rstrip("\n"))
        if line.startswith("ended"):
            break
    raise BrokenPromise(f"a life was not ended by a kill; its last words: {lines[-2:]}")


def require_undisturbed(folder: Path, witness: Witness) -> None:
    """Compare all replies and the last coordinates with those of an undisturbed process.

    Raises
    ------
    BrokenPromise
        If a bit differs.
    """
    survivor = open_session(SessionStore(folder), witness.lives)
    last = survivor.host.step
    require(last in (witness.last, witness.last + 1), f"step {last} at the end, {witness.last} was acknowledged")
    undisturbed = make_driver(SessionStore("/undisturbed", files=ModelFiles()), [grid_mesh()])
    undisturbed.open()
    expected = run_to(undisturbed, last)
    for step, frame in witness.replies.items():
        require(frame == expected[step], f"the reply of step {step} differs from an undisturbed run")
    require(np.array_equal(final_points(survivor), final_points(undisturbed)), f"the coordinates of step {last} differ")
    survivor.host.close()


def run(seed: int, budget: Budget) -> Result:
    """Kill, then compare."""
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder:
        witness = kill_again_and_again(Path(folder), Random(f"kill -9 {seed}"), budget)
        require_undisturbed(Path(folder), witness)
    require(witness.recoveries, "no life was long enough to resume the session")
    require(len(witness.replies) >= witness.lives / 20, f"only {len(witness.replies)} steps in {witness.lives} lives")
    p50, p95 = (float(value) for value in np.percentile(witness.recoveries, (50, 95)))
    details = {
        "kills": witness.lives,
        "acknowledged": len(witness.replies),
        "asked_again": witness.repeats,
        "recovered": len(witness.recoveries),
        "recovery_p50_seconds": p50,
        "recovery_p95_seconds": p95,
        "recovery_target_seconds": _RECOVERY_SECONDS,
    }
    got = f"{witness.lives} kills, {len(witness.replies)} steps, 0 lost, recovery p95 {1000 * p95:.0f} ms"
    return Result(got, p95 <= _RECOVERY_SECONDS, details)


CHECK = Check(
    "kill-9",
    "{count} kills: no step lost, all bitwise, recovery p95 ≤ 2 s",
    short=100,
    full=2000,
    seconds=20,
    run=run,
)

"""SIGKILL of a process that commits, at random moments of opening, recovering and committing.

The runs are divided among sessions of the three levels of durability. Every reply, also to a request repeated after a
kill, and the coordinates at the end must be bitwise those of an undisturbed process, which commits the same steps on
the model file system. With "relaxed" a session may resume before its last acknowledged step, but not before the last
step that a reply called durable, and the repeated steps must be bitwise the same. The kernel survives, so this does not
show that data was synced: the power-loss check does.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import numpy as np
from mesh_motion_protocol.messages import Fetch

from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import DURABILITY_LEVELS
from tests.faults.check import BrokenPromise, Budget, Check, Result, require
from tests.faults.killed_process import open_session
from tests.faults.stand_in import grid_mesh
from tests.faults.undisturbed import Undisturbed

#: A life lasts up to so many seconds: some tens of commits, or not even its recovery. On a machine so busy that no step
#: is reached, each life may last as much longer than the one before.
_LONGEST = 0.2
#: Lives in a row that commit nothing, each longer than the last: the last of them may take eight seconds.
_MOST_IDLE = 40
#: One thread each: this proof does not test what a fork leaves of other threads.
_FORKABLE = {"MESH_MOTION_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
#: The longest recovery at the 95th percentile.
_RECOVERY_SECONDS = 2.0


@dataclass
class Witness:
    """The output of the killed processes.

    ``replies``: the COMMITTED frame of each acknowledged step; ``recoveries``: seconds from fork to an open session;
    ``repeats``: replies that came again after a kill; ``level``: of durability; ``last``, ``durable``: the last
    acknowledged step, and the last one that a reply called durable; ``lost``: acknowledged steps that were not durable
    and did not survive.
    """

    replies: dict[int, bytes] = field(default_factory=dict)
    recoveries: list[float] = field(default_factory=list)
    repeats: int = 0
    lives: int = 0
    level: str = "full"
    last: int = 0
    durable: int = 0
    lost: int = 0

    def check(self, lines: Iterable[str]) -> None:
        """The lines of one life.

        Raises BrokenPromise if an acknowledged step is lost or a repeated reply differs.
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
        relaxed = self.level == "relaxed"
        require(
            (self.durable if relaxed else self.last) <= int(step) <= self.last + 1,
            f"life {self.lives} resumes at step {step}, {self.last} was acknowledged, {self.durable} was durable",
        )
        self.lost += max(0, self.last - int(step))
        self.last = self.durable = int(step)
        if self.lives > 1:
            self.recoveries.append(float(seconds))

    def _replied(self, rest: str) -> None:
        step, durable = (int(word) for word in rest.split()[:2])
        frame = bytes.fromhex(rest.split()[2])
        require(durable == step or self.level == "relaxed", f"step {step} was acknowledged, {durable} was durable")
        asked_again = step == self.last
        self.last, self.durable = step, max(self.durable, durable)
        known = self.replies.setdefault(step, frame)
        require(known == frame, f"the repeated reply of step {step} differs in life {self.lives}")
        self.repeats += asked_again


def kill_again_and_again(folder: Path, random: Random, budget: Budget, level: str = "full") -> Witness:
    """Run this number of lives of a session in a folder, at a level of durability; more until one has resumed and
    committed.

    Raises BrokenPromise as :meth:`Witness.check`, or if a process ended by itself.
    """
    witness = Witness(level=level)
    command = [sys.executable, "-m", "tests.faults.killed_process", str(folder), level]
    environment = os.environ | _FORKABLE
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        idle = 0
        while budget.admits(witness.lives) or not (witness.recoveries and witness.replies):
            process.stdin.write(f"{random.uniform(0, _LONGEST * (1 + idle)):.6f}\n")
            process.stdin.flush()
            former = len(witness.replies)
            witness.check(_one_life(process.stdout))
            idle = idle + 1 if len(witness.replies) == former else 0
            require(
                idle < _MOST_IDLE, f"after step {witness.last}, {idle} lives in a row have committed nothing ({level})"
            )
        process.stdin.close()
    return witness


def _one_life(output: Iterable[str]) -> list[str]:
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

    Raises BrokenPromise if a bit differs.
    """
    survivor = open_session(SessionStore(folder), witness.lives)
    last = survivor.host.step
    promised = witness.durable if witness.level == "relaxed" else witness.last
    require(promised <= last <= witness.last + 1, f"step {last} at the end, {witness.last} was acknowledged")
    undisturbed, points = Undisturbed([grid_mesh()]), survivor.ask(Fetch).points
    require(np.array_equal(points, undisturbed.points(last)[0]), f"the coordinates of step {last} differ")
    for step, frame in witness.replies.items():
        expected = undisturbed.step(step).replies[0]
        require(frame == expected, f"the reply of step {step} differs from an undisturbed run")
    survivor.host.close()


def run(seed: int, budget: Budget) -> Result:
    witnesses, lives = [], 0
    for number, level in enumerate(DURABILITY_LEVELS, start=1):
        with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder:
            share = Budget(round(budget.count * number / len(DURABILITY_LEVELS)) - lives)
            witness = kill_again_and_again(Path(folder), Random(f"kill -9 {seed} {level}"), share, level)
            require_undisturbed(Path(folder), witness)
        steps = len(witness.replies)
        require(steps >= witness.lives / 20, f"only {steps} steps in {witness.lives} lives ({level})")
        witnesses.append(witness)
        lives += witness.lives
    recoveries = [seconds for witness in witnesses for seconds in witness.recoveries]
    p50, p95 = (float(value) for value in np.percentile(recoveries, (50, 95)))
    acknowledged = sum(len(witness.replies) for witness in witnesses)
    details = {
        "kills": lives,
        "acknowledged": acknowledged,
        "asked_again": sum(witness.repeats for witness in witnesses),
        "recovered": len(recoveries),
        "relaxed_steps_done_again": witnesses[-1].lost,
        "recovery_p50_seconds": p50,
        "recovery_p95_seconds": p95,
        "recovery_target_seconds": _RECOVERY_SECONDS,
    }
    got = f"{lives} kills, {acknowledged} steps, 0 promised ones lost, recovery p95 {1000 * p95:.0f} ms"
    return Result(got, p95 <= _RECOVERY_SECONDS, details)


CHECK = Check(
    "kill-9",
    "{count} kills, 3 levels: no promised step lost, bitwise, p95 ≤ 2 s",
    short=120,
    full=3000,
    seconds=24,
    run=run,
)

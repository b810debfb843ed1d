"""IDWarp's Jᵀ w in this process: ``python -m benchmarks.peers.idwarp_gradient FOLDER REPEAT``.

The folder has ``task.npz``, and in ``weights.npy`` the (n, 3) weights of all nodes. The module writes ``seconds.json``
there, and ``gradient.npy``, the weights (k, 3) of the moving nodes' positions after the last step.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.peers.movers.idwarp import IDWarpMover
from benchmarks.peers.task import Task


def main(folder: Path, repeat: int) -> None:
    """Processor seconds of the shortest step and of the shortest Jᵀ w."""
    task, weights = Task.load(folder / "task.npz"), np.load(folder / "weights.npy")
    mover, steps, vectors = IDWarpMover(task), [], []
    for step in range(task.steps):
        start = time.process_time()
        mover.move(step)
        steps.append(time.process_time() - start)
    for _ in range(repeat):
        start = time.process_time()
        gradient = mover.cotangent(weights)
        vectors.append(time.process_time() - start)
    np.save(folder / "gradient.npy", gradient)
    seconds = {"step": min(steps), "cotangent": min(vectors)}
    (folder / "seconds.json").write_text(json.dumps(seconds), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))

"""``python tests/mutation [--all] [--like TEXT] [--sample N] [--seed N] [MODULE …]``: do tests notice changed code?

Every mutant that no test notices must stand in ``survivors.toml``, with the reason why it is none: exit status 0 if so,
1 if there is another one. Those that stand there are not tried, except with ``--all``, which tells those that are
noticed after all. Well-known tools do not fit: cosmic-ray starts a process for each mutant, which costs seconds
of imports here, and mutmut leaves out what is decorated (properties, context managers) and functions inside functions.
"""

import argparse
import os
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def tell(line: str) -> None:
    """To standard output at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> int:
    """Mutate, test, compare with the survivors that are known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*")
    parser.add_argument("--all", action="store_true", help="also those that are explained")
    parser.add_argument("--like", default="", help="only those with this in their names")
    parser.add_argument("--sample", type=int, help="so many mutants of each module, at random")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(HERE))
    os.environ.setdefault("MESH_MOTION_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")

    # only now: whatever starts threads reads these when it is loaded
    from mutation_run import Trial, run  # noqa: PLC0415
    from mutation_targets import TARGETS  # noqa: PLC0415

    modules = given.modules or list(TARGETS)
    known = tomllib.loads((HERE / "survivors.toml").read_text(encoding="utf-8"))
    rows, unexplained = [], 0
    for tests in dict.fromkeys(TARGETS[name].tests for name in modules):
        own = {name: TARGETS[name].own for name in modules if TARGETS[name].tests == tests}
        trial = run(Trial(own, {} if given.all else known, given.like, given.sample, given.seed), tests)
        if trial.problem:
            sys.exit(trial.problem)
        for name, outcome in trial.outcomes.items():
            explained = known.get(name, {})
            new = [key for key in outcome.survived if key not in explained]
            for key in new:
                tell(f"{name}: nobody notices: {key}")
            if given.all and not (given.like or given.sample):
                for key in sorted(explained.keys() - set(outcome.survived)):
                    tell(f"{name}: is noticed now, or is gone: {key}")
            counts = (outcome.tried, outcome.killed, outcome.late, len(explained), len(new), outcome.seconds)
            rows.append((name, outcome.tried + outcome.left, *counts))
            unexplained += len(new)
    summary(rows)
    return 1 if unexplained else 0


def summary(rows: list[tuple[str, *tuple[float, ...]]]) -> None:
    """One line a module, and their sum."""
    heads = ("mutants", "tried", "noticed", "by time", "explained", "open", "seconds")
    width = max(len(name) for name, *_ in rows)
    tell(" " * width + "".join(f"{head:>11}" for head in heads))
    for name, *numbers in (*rows, ("together", *map(sum, zip(*(row[1:] for row in rows), strict=True)))):
        tell(f"{name:{width}}" + "".join(f"{number:11.0f}" for number in numbers))


if __name__ == "__main__":
    sys.exit(main())

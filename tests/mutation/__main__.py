"""``python tests/mutation [--sample N] [--seed N] [MODULE …]``: do the tests notice small changes of the code?

Every mutant that no test notices must stand in ``survivors.toml``, with the reason why it is none: exit status 0 if so,
1 if there is another one. Well-known tools do not fit: cosmic-ray starts a process for each mutant, which costs seconds
of imports here, and mutmut leaves out what is decorated (properties, context managers) and functions inside functions.
"""

from __future__ import annotations

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
    parser.add_argument("--sample", type=int, help="so many mutants of each module, at random")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(HERE))
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")

    # only now: whatever starts threads reads these when it is loaded
    from mutation_run import Trial, run  # noqa: PLC0415
    from mutation_targets import TARGETS  # noqa: PLC0415

    modules = given.modules or list(TARGETS)
    known = tomllib.loads((HERE / "survivors.toml").read_text(encoding="utf-8"))
    unexplained = tried = 0
    for tests in dict.fromkeys(TARGETS[name] for name in modules):
        own = [name for name in modules if TARGETS[name] == tests]
        trial = run(Trial(own, given.sample, given.seed), tests)
        if trial.problem:
            sys.exit(trial.problem)
        for name, outcome in trial.outcomes.items():
            new = [key for key in outcome.survived if key not in known.get(name, {})]
            stale = [] if given.sample else sorted(known.get(name, {}).keys() - set(outcome.survived))
            tell(f"{name}: {outcome.killed} of {outcome.total} noticed, {len(outcome.survived) - len(new)} known")
            for key in new:
                tell(f"  nobody notices: {key}")
            for key in stale:
                tell(f"  is noticed now, or is gone: {key}")
            unexplained += len(new)
            tried += outcome.total
    tell(f"{tried} mutants, {unexplained} unexplained survivors")
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())

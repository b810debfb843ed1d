"""scikit-build-core for numerics and server, with a compiler from PyPI (``ziglang``, 100 MB) if there is no other.

``pip install .`` in a checkout, or in an archive of it, installs client and numerics from their folders, because their
versions may not be released yet. A wheel, a source distribution and an editable installation require their releases.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from scikit_build_core import build as _backend

__all__ = [
    "build_editable", "build_sdist", "build_wheel", "get_requires_for_build_editable", "get_requires_for_build_sdist",
    "get_requires_for_build_wheel", "prepare_metadata_for_build_editable", "prepare_metadata_for_build_wheel",
]  # fmt: skip

build_sdist, get_requires_for_build_sdist = _backend.build_sdist, _backend.get_requires_for_build_sdist
prepare_metadata_for_build_editable = _backend.prepare_metadata_for_build_editable


def _needs_compiler() -> bool:
    """Whether CMake would find no compiler, in CXX or by one of these names; the server has nothing to compile."""
    compiles = Path("kernels", "CMakeLists.txt").exists()  # build front ends run the hooks in the project's folder
    return compiles and "CXX" not in os.environ and not any(map(shutil.which, ("c++", "g++", "clang++")))


def get_requires_for_build_wheel(settings: Any = None) -> list[str]:
    return [*_backend.get_requires_for_build_wheel(settings), *(["ziglang>=0.13"] if _needs_compiler() else [])]


def get_requires_for_build_editable(settings: Any = None) -> list[str]:
    return [*_backend.get_requires_for_build_editable(settings), *(["ziglang>=0.13"] if _needs_compiler() else [])]


@contextmanager
def _compiler() -> Iterator[None]:
    """Provide Zig under the names that CMake looks for, if there is no other compiler."""
    if not _needs_compiler():
        yield
        return
    before = dict(os.environ)
    with TemporaryDirectory() as folder:
        for name, tool in (("cc", "cc"), ("c++", "c++"), ("ar", "ar"), ("ranlib", "ranlib")):
            script = Path(folder, name)
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {tool} "$@"\n')
            script.chmod(0o755)
        os.environ |= {"PATH": f"{folder}{os.pathsep}{before['PATH']}", "CC": f"{folder}/cc", "CXX": f"{folder}/c++"}
        try:
            yield
        finally:
            os.environ.clear()
            os.environ |= before


@contextmanager
def _parts_from_checkout() -> Iterator[None]:
    """Let own_releases.py require the folders of the parts when pip installs a checkout or an archive of it."""
    root = Path(__file__).resolve().parents[2]
    folders = {"mesh-motion-client": root / "adapters" / "python", "mesh-motion-numerics": root / "numerics"}
    # an archive of the repository has no .git, a source distribution has PKG-INFO
    whole = all(path.is_dir() for path in folders.values()) and not (root / "PKG-INFO").exists()
    # pip sets it for the hooks that it runs; build does not
    by_pip = "PIP_BUILD_TRACKER" in os.environ and "CIBUILDWHEEL" not in os.environ
    if not (whole and by_pip):
        yield
        return
    os.environ["MESH_MOTION_PARTS"] = json.dumps({name: f" @ {path.as_uri()}" for name, path in folders.items()})
    try:
        yield
    finally:
        del os.environ["MESH_MOTION_PARTS"]


def prepare_metadata_for_build_wheel(folder: str, settings: Any = None) -> str:
    with _parts_from_checkout():
        return _backend.prepare_metadata_for_build_wheel(folder, settings)


def build_wheel(folder: str, settings: Any = None, metadata: str | None = None) -> str:
    with _compiler(), _parts_from_checkout():
        return _backend.build_wheel(folder, settings, metadata)


def build_editable(folder: str, settings: Any = None, metadata: str | None = None) -> str:
    with _compiler():
        return _backend.build_editable(folder, settings, metadata)

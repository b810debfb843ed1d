"""scikit-build-core, with a compiler from PyPI (``ziglang``, 100 MB) where the machine has none.

``pip install .`` in a checkout takes the client from ``adapters/python``, as it may not have been released. A wheel, a
source distribution and an editable installation require the client's release.
"""

from __future__ import annotations

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
    """CMake's own search: CXX, or one of these names."""
    return "CXX" not in os.environ and not any(map(shutil.which, ("c++", "g++", "clang++")))


def get_requires_for_build_wheel(settings: Any = None) -> list[str]:
    return [*_backend.get_requires_for_build_wheel(settings), *(["ziglang>=0.13"] if _needs_compiler() else [])]


def get_requires_for_build_editable(settings: Any = None) -> list[str]:
    return [*_backend.get_requires_for_build_editable(settings), *(["ziglang>=0.13"] if _needs_compiler() else [])]


@contextmanager
def _compiler() -> Iterator[None]:
    """Zig under the names that CMake looks for, where there is nothing else."""
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
def _client_beside() -> Iterator[None]:
    """The requirement of kernels/client_dependency.py is the folder, where pip installs a checkout."""
    root = Path(__file__).resolve().parents[1]
    # pip sets it for the hooks that it runs, and build does not
    by_pip = "PIP_BUILD_TRACKER" in os.environ and "CIBUILDWHEEL" not in os.environ
    if not ((root / ".git").exists() and by_pip):
        yield
        return
    os.environ["MESH_MOTION_CLIENT"] = f" @ {(root / 'adapters' / 'python').as_uri()}"
    try:
        yield
    finally:
        del os.environ["MESH_MOTION_CLIENT"]


def prepare_metadata_for_build_wheel(folder: str, settings: Any = None) -> str:
    with _client_beside():
        return _backend.prepare_metadata_for_build_wheel(folder, settings)


def build_wheel(folder: str, settings: Any = None, metadata: str | None = None) -> str:
    with _compiler(), _client_beside():
        return _backend.build_wheel(folder, settings, metadata)


def build_editable(folder: str, settings: Any = None, metadata: str | None = None) -> str:
    with _compiler():
        return _backend.build_editable(folder, settings, metadata)

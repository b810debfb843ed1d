"""Fetch the files that the monitor page's ``static/vendor/vendor.toml`` lists with the npm client, and verify them.

``python tools/fetch_vendor.py`` compares the files here with their sums and the packages;
``--write`` replaces them (after a version or a sum was changed in vendor.toml); ``--tests`` fetches files that only
tests use into ``out/vendor``. Ends with status 1 if anything differs.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
VENDOR = ROOT / "mesh_motion_server" / "watch" / "page" / "static" / "vendor"
TESTS = ROOT / "out" / "vendor"


def packed(package: str, version: str, folder: Path) -> tarfile.TarFile:
    """The archive of a package in this version, from whichever registry npm is set up for."""
    order = ["npm", "pack", f"{package}@{version}", "--silent", "--pack-destination", str(folder)]
    subprocess.run(order, check=True, capture_output=True)
    (archive,) = folder.glob("*.tgz")
    return tarfile.open(archive)


def fetch(package: str, version: str, names: list[str]) -> dict[str, bytes]:
    """The content of these files of a package."""
    with tempfile.TemporaryDirectory() as folder, packed(package, version, Path(folder)) as archive:
        members = {name: archive.extractfile(f"package/{name}") for name in names}
        return {name: member.read() for name, member in members.items() if member is not None}


def differing(entry: dict[str, Any], target: Path, *, write: bool) -> list[str]:
    """Files of one package that differ from vendor.toml, here or in the package."""
    wrong = []
    for name, content in fetch(entry["package"], entry["version"], list(entry["files"])).items():
        here = target / entry["package"] / Path(name).name
        if hashlib.sha256(content).hexdigest() != entry["files"][name]:
            wrong.append(f"{entry['package']}@{entry['version']}: the sum of {name} differs from vendor.toml")
        elif write:
            here.parent.mkdir(parents=True, exist_ok=True)
            here.write_bytes(content)
        elif not here.exists() or here.read_bytes() != content:
            wrong.append(f"{here} differs from {entry['package']}@{entry['version']}: {name}")
    return wrong


def main() -> int:
    """Compare or write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="replace the files")
    parser.add_argument("--tests", action="store_true", help="fetch what only tests use")
    chosen = parser.parse_args()
    tables = tomllib.loads((VENDOR / "vendor.toml").read_text())
    kind, target = ("tests", TESTS) if chosen.tests else ("vendored", VENDOR)
    wrong = [line for entry in tables[kind] for line in differing(entry, target, write=chosen.write or chosen.tests)]
    sys.stdout.write("".join(f"{line}\n" for line in wrong) or "as vendor.toml says\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

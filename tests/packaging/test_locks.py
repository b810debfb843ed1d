"""The exact environments fulfil the requirements, have a hash for each file, and name no package index."""

import re
import tomllib

import pytest
from bare_environment import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]
CLIENT = tomllib.loads((ROOT / "adapters" / "python" / "pyproject.toml").read_text(encoding="utf-8"))
NUMERICS = tomllib.loads((ROOT / "numerics" / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["scikit-build"]
#: The packages that the distributions require without an extra.
BASES = {"client": CLIENT["project"]["dependencies"], "numerics": NUMERICS["metadata"]["dependencies"]["others"]}
FOLDER = ROOT / "requirements"
_PIN = re.compile(
    r"^([A-Za-z0-9._-]+)==(\S+)((?: ;[^\\\n]*)?) \\\n((?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)", re.MULTILINE
)


def pins(name: str) -> dict[str, list[str]]:
    """Distribution → versions (several where systems differ) of a lock file."""
    text = (FOLDER / f"{name}.lock").read_text(encoding="utf-8")
    assert _PIN.sub("", text).strip() == "", "each line is a pin with its hashes, and nothing else"
    found: dict[str, list[str]] = {}
    for match in _PIN.finditer(text):
        found.setdefault(canonicalize_name(match[1]), []).append(match[2])
    return found


def required(extra: str) -> list[Requirement]:
    """Requirements of a base or an extra, with the extras that it names."""
    found = [Requirement(line) for line in BASES.get(extra) or EXTRAS[extra]]
    inner = [part for requirement in found if requirement.name == "mesh-motion-server" for part in requirement.extras]
    return [r for r in found if r.name != "mesh-motion-server"] + [r for part in inner for r in required(part)]


@pytest.mark.parametrize(
    ("name", "extras"),
    [("client", ["client"]), ("server", [*BASES, "server"]), ("dev", [*BASES, "all", "docs", "dev"])],
)
def test_a_lock_satisfies_what_is_required(name: str, extras: list[str]) -> None:
    locked = pins(name)
    for requirement in (r for extra in extras for r in required(extra)):
        versions = locked.get(canonicalize_name(requirement.name), [])
        fits = [requirement.specifier.contains(version, prereleases=True) for version in versions]
        assert fits, f"{requirement} is not in {name}.lock: run `make lock`"
        assert all(fits), f"{requirement} is {versions} in {name}.lock: run `make lock`"


def test_the_build_lock_has_what_the_build_requires() -> None:
    locked = pins("build")
    for line in PROJECT["build-system"]["requires"]:
        requirement = Requirement(line)
        assert all(requirement.specifier.contains(version) for version in locked[requirement.name])


def test_the_locks_agree() -> None:
    dev = pins("dev")
    for name in ("client", "server"):
        assert {k: v for k, v in pins(name).items() if dev.get(k) != v} == {}

"""``make release VERSION=x.y.z``: check a release's requirements, build it twice, try it, print the next steps.

A failed check prints one line with the expected value, the value found and the way out. Nothing is changed but the
folder ``dist``, and with ``--tag`` one tag; nothing is uploaded.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from tools.wheel import Failed, build, run, try_wheels

__all__ = ["CHECKS", "Refused", "main"]

_VERSION = re.compile(r"\d+\.\d+\.\d+")
_FROM_SOURCES = (
    Path("adapters/python/mesh_motion_protocol/__init__.py"),
    Path("numerics/mesh_motion_numerics/__init__.py"),
)


class Refused(Exception):
    """The requirements of a release are not met."""


# --- what is checked -------------------------------------------------------------------------------------------------


def check_number(root: Path, version: str) -> None:
    """Three numbers."""
    del root
    if not _VERSION.fullmatch(version):
        raise Refused(f"VERSION must be three numbers, as 1.2.3, got {version!r}")


def check_tree(root: Path, version: str) -> None:
    """Check that the checkout has no uncommitted changes."""
    del version
    changed = _git(root, "status", "--porcelain").splitlines()
    if changed:
        raise Refused(f"the tree must be clean, but {len(changed)} files are not, first {changed[0][3:]}: commit them")


def check_tag(root: Path, version: str) -> None:
    """A version is released once."""
    if _git(root, "tag", "--list", f"v{version}"):
        raise Refused(f"the tag v{version} exists already: choose the next version")


def check_sources(root: Path, version: str) -> None:
    """Check the version in all its places."""
    for source in _FROM_SOURCES:
        found = _match(root / source, r'^__version__ = "(.+)"$')
        if found != version:
            raise Refused(f"{source} must have __version__ = {version!r}, got {found!r}: write it there")


def check_citation(root: Path, version: str) -> None:
    """Check that the citation has the released version, and the date of the changelog."""
    found = _match(root / "CITATION.cff", r'^version: "?([^"\n]+)"?$')
    if found != version:
        raise Refused(f"CITATION.cff must have version: {version}, got {found!r}: write it there")
    day = _match(root / "CHANGELOG.md", rf"^## {re.escape(version)} [-–—] (\d{{4}}-\d{{2}}-\d{{2}})$")
    released = _match(root / "CITATION.cff", r'^date-released: "?([^"\n]+)"?$')
    if day and released != day:
        raise Refused(f"CITATION.cff must have date-released: {day}, as CHANGELOG.md, got {released!r}: write it there")


def check_changelog(root: Path, version: str) -> None:
    """Check that the changelog has a dated section with content, and an empty one for later changes."""
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    titles = [section.partition("\n")[0].strip() for section in sections]
    title = re.compile(rf"{re.escape(version)} [-–—] \d{{4}}-\d{{2}}-\d{{2}}")
    mine = [section for section in sections if title.fullmatch(section.partition("\n")[0].strip())]
    if not mine:
        raise Refused(
            f"CHANGELOG.md must have a section '## {version} - YYYY-MM-DD', got {', '.join(titles[:3])}: "
            "give the unreleased changes this title"
        )
    if "\n- " not in mine[0]:
        raise Refused(f"CHANGELOG.md's section {version} lists no change")
    if any(section.startswith("Unreleased") and "\n- " in section for section in sections):
        raise Refused("CHANGELOG.md still has unreleased changes: they belong to this version or the next")


def check_fragments(root: Path, version: str) -> None:
    """Check that the changelog has all news fragments."""
    left = sorted(path.name for path in (root / "changes").glob("*.md") if path.name != "README.md")
    if left:
        raise Refused(
            f"changes/ must have no news fragments, got {len(left)}, first {left[0]}: "
            f"towncrier build --version {version}"
        )


def check_protocol(root: Path, version: str) -> None:
    """Check that the document and the code have the same protocol version."""
    del version
    program = "from mesh_motion_protocol import PROTOCOL_VERSION as v; print(*v, sep='.')"
    answer = run([sys.executable, "-c", program], root, "the protocol cannot be imported").strip()
    written = _match(root / "protocol" / "SPEC.md", r"(?i)\bversion[: ]+\**(\d+\.\d+)")
    if written != answer:
        raise Refused(f"protocol/SPEC.md must be of version {answer}, as mesh_motion_protocol says, got {written!r}")


def check_rendered(root: Path, version: str) -> None:
    """Check that generated files are up to date: SPEC.md's tables, the manual pages, the lock files."""
    del version
    tests = ["tests/protocol/test_spec.py", "tests/packaging/test_locks.py", "tests/packaging/test_manual.py::"
             "test_the_pages_are_those_of_the_commands"]  # fmt: skip
    ways = "python -m protocol.render_spec, make manual, make lock"
    run([sys.executable, "-m", "pytest", "-q", "-x", *tests], root, f"a rendered file is old: {ways}")


#: In the order in which they are made, the quick ones first.
CHECKS: tuple[Callable[[Path, str], None], ...] = (
    check_number,
    check_sources,
    check_citation,
    check_changelog,
    check_fragments,
    check_tag,
    check_tree,
    check_protocol,
    check_rendered,
)


# --- what is built ---------------------------------------------------------------------------------------------------


def build_twice(root: Path, folder: Path) -> list[Path]:
    """Build source distributions and wheels; a second build must give the same bits."""
    epoch = _git(root, "log", "-1", "--format=%ct")
    made: list[dict[str, bytes]] = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as scratch:
            built = build(root, Path(scratch), epoch)
            made.append({path.name: path.read_bytes() for path in built})
    differing = [name for name in made[0] if made[0][name] != made[1].get(name)]
    if differing:
        raise Refused(f"two builds must be equal bit for bit, but {differing[0]} is not")
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in made[0].items():
        (folder / name).write_bytes(content)
    return [folder / name for name in made[0]]


def write_checksums(files: Sequence[Path]) -> Path:
    """``SHA256SUMS`` in their folder, as ``sha256sum --check`` reads it."""
    sums = files[0].parent / "SHA256SUMS"
    sums.write_text("".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files))
    return sums


# --- the program -----------------------------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    """Return 0, or 1 with one line with the reason why there is no release."""
    parser = argparse.ArgumentParser(prog="release", description=__doc__)
    parser.add_argument("version")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1], help="the checkout")
    parser.add_argument("--only-checks", action="store_true", help="build nothing")
    parser.add_argument("--no-tests", action="store_true", help="do not run the test suite (it has been run)")
    parser.add_argument("--no-install", action="store_true", help="do not install the wheels (needs a package index)")
    parser.add_argument("--tag", action="store_true", help="tag the commit")
    options = parser.parse_args(arguments)
    try:
        for line in _release(options):
            sys.stdout.write(line + "\n")
    except (Refused, Failed) as error:
        sys.stderr.write(f"release: {error}\n")
        return 1
    return 0


def _release(options: argparse.Namespace) -> list[str]:
    """Print the finished and the next steps, one line each."""
    root, version = options.root, options.version
    for check in CHECKS:
        check(root, version)
    if options.only_checks:
        return [f"{version} may be released"]
    if not options.no_tests:
        run(["make", "-s", "lint", "test-all"], root, "lint or tests fail: make lint test-all")
    files = build_twice(root, root / "dist")
    if not options.no_install:
        try_wheels(root, files)
    answer = [f"built {path.relative_to(root)}" for path in (*files, write_checksums(files))]
    if options.tag:
        _git(root, "tag", "--annotate", f"v{version}", "--message", f"Version {version}")
        return [*answer, f"tagged v{version}", f"next: git push origin v{version}; upload the files in dist"]
    return [*answer, f"next: make release VERSION={version} RELEASE='--tag --no-tests'"]


def _match(path: Path, pattern: str) -> str:
    """Text of the first group of a pattern in a file, or nothing."""
    found = re.search(pattern, path.read_text(encoding="utf-8"), re.MULTILINE)
    return found[1].strip() if found else ""


def _git(root: Path, *arguments: str) -> str:
    return run(["git", *arguments], root, f"git {arguments[0]} fails").strip()


if __name__ == "__main__":
    sys.exit(main())

"""Each check of a release refuses its fault; two builds are bitwise equal, and nothing else is changed."""

import hashlib
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bare_environment import ROOT

from tools import release
from tools.release import CHECKS, Refused, build_twice, main, write_checksums

VERSION = "7.8.9"


def git(root: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=A", "-c", "user.email=a@b.c"]
    return subprocess.run(["git", *identity, *arguments], cwd=root, check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="module")
def ready(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone in which version 7.8.9 may be released."""
    root = tmp_path_factory.mktemp("release") / "clone"
    cloned = subprocess.run(["git", "clone", "-q", "--shared", ROOT, root], capture_output=True, check=False)
    if cloned.returncode:
        pytest.skip("not in a git checkout")
    for name, pattern, text in (
        ("adapters/python/mesh_motion_protocol/__init__.py", r'__version__ = ".*"', f'__version__ = "{VERSION}"'),
        ("numerics/mesh_motion_numerics/__init__.py", r'__version__ = ".*"', f'__version__ = "{VERSION}"'),
        ("CITATION.cff", r"(?m)^version: .*", f"version: {VERSION}"),
        ("CITATION.cff", r"(?m)^date-released: .*", "date-released: 2026-01-31"),
        ("CHANGELOG.md", "## Unreleased", f"## Unreleased\n\n## {VERSION} - 2026-01-31"),
    ):
        replace(root / name, pattern, text)
    for fragment in {*(root / "changes").glob("*.md")} - {root / "changes" / "README.md"}:
        fragment.unlink()  # as the release does with those of today
    git(root, "commit", "-qam", "A release")
    return root


@pytest.fixture
def clone(ready: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(ready, tmp_path / "clone", symlinks=True))


def replace(path: Path, pattern: str, text: str) -> None:
    old = path.read_text(encoding="utf-8")
    new = re.sub(pattern, lambda _: text, old, count=1)
    assert new != old
    path.write_text(new, encoding="utf-8")


#: One change of a file or more (name, pattern, text), and the message that it causes.
SPOILT: list[tuple[tuple[str, str, str] | Callable[[Path], object], str]] = [
    (("adapters/python/mesh_motion_protocol/__init__.py", "7.8.9", "7.8.8"),
     r"protocol/__init__\.py must have __version__ = '7\.8\.9', got '7\.8\.8'"),
    (("numerics/mesh_motion_numerics/__init__.py", "7.8.9", "7.8.8"),
     r"numerics/__init__\.py must have __version__ = '7\.8\.9', got '7\.8\.8'"),
    (("CITATION.cff", "7.8.9", "0.1.0"), r"CITATION\.cff must have version: 7\.8\.9, got '0\.1\.0'"),
    (("CITATION.cff", "2026-01-31", "2026-01-30"),
     r"CITATION\.cff must have date-released: 2026-01-31, as CHANGELOG\.md, got '2026-01-30'"),
    (("CHANGELOG.md", " - 2026-01-31", ""),
     "CHANGELOG.md must have a section '## 7.8.9 - YYYY-MM-DD', got Unreleased, 7.8.9"),
    (("CHANGELOG.md", "(?s)## 7.8.9 - 2026-01-31.*", "## 7.8.9 - 2026-01-31\n"), "section 7.8.9 lists no change"),
    (("CHANGELOG.md", "## Unreleased\n", "## Unreleased\n\n- One more.\n"), "still has unreleased changes"),
    (lambda root: (root / "changes" / "+slip-walls.fixed.md").write_text("Walls slide.\n"),
     r"got 1, first \+slip-walls\.fixed\.md: towncrier build --version 7\.8\.9"),
    (lambda root: git(root, "tag", "v7.8.9"), "the tag v7.8.9 exists already"),
    (lambda root: (root / "mesh_motion_server" / "forgotten.py").touch(), "first mesh_motion_server/forgotten.py"),
    (("protocol/SPEC.md", r"version 1\.0", "version 1.1"),
     "must be of version 1.0, as mesh_motion_protocol says, got '1.1'"),
    (("docs/man/mesh-motion.1", "(?s).*", ""), r"python -m protocol\.render_spec, make manual, make lock"),
]  # fmt: skip


@pytest.mark.parametrize(("spoilt", "words"), SPOILT, ids=[words[:40] for _, words in SPOILT])
def test_a_check_refuses(clone: Path, spoilt: Any, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    if callable(spoilt):
        spoilt(clone)
    else:
        name, pattern, text = spoilt
        replace(clone / name, pattern, text)
        git(clone, "commit", "-qam", "Spoilt")
    assert main([VERSION, "--root", str(clone), "--only-checks"]) == 1
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert re.search(words, complaint), complaint


def test_news_fragments_become_a_section_that_may_be_released(clone: Path) -> None:
    kinds = ["added", "changed", "deprecated", "removed", "fixed", "security"]
    for kind in kinds:
        (clone / "changes" / f"+{kind}.{kind}.md").write_text(f"What was {kind}.\n")
    git(clone, "add", "changes")
    build = [sys.executable, "-m", "towncrier", "build", "--yes", "--version", "7.9.0", "--date", "2026-02-01"]
    subprocess.run(build, cwd=clone, check=True, capture_output=True)
    release.check_changelog(clone, "7.9.0")
    release.check_fragments(clone, "7.9.0")
    section = (clone / "CHANGELOG.md").read_text(encoding="utf-8").partition("## 7.9.0 - 2026-02-01\n")[2]
    assert re.findall(r"(?m)^(?:### .*|- .*)", section.partition("\n## ")[0]) == [
        line for kind in kinds for line in (f"### {kind.capitalize()}", f"- What was {kind}.")
    ]


@pytest.mark.parametrize("version", ["1.2", "v1.2.3", "1.2.3rc1", ""])
def test_a_version_is_three_numbers(ready: Path, version: str) -> None:
    with pytest.raises(Refused, match="three numbers"):
        CHECKS[0](ready, version)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_a_ready_checkout_passes_and_is_built_twice_the_same(
    ready: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # One instruction set, and half the time of compiling: `make wheel` builds all sets, optimised.
    monkeypatch.setenv("SKBUILD_CMAKE_DEFINE", "MESH_MOTION_LEVELS=v3")
    (tmp_path / "unoptimised").write_text('#!/bin/sh\nexec "$@" -O0\n')
    (tmp_path / "unoptimised").chmod(0o755)
    monkeypatch.setenv("CMAKE_CXX_COMPILER_LAUNCHER", str(tmp_path / "unoptimised"))
    assert main([VERSION, "--root", str(ready), "--no-tests", "--no-install", "--tag"]) == 0, capsys.readouterr().err
    assert "next: git push origin v7.8.9" in capsys.readouterr().out
    assert git(ready, "tag").split() == [f"v{VERSION}"]
    assert git(ready, "status", "--porcelain") == ""
    built = sorted(path.name for path in (ready / "dist").iterdir())
    sums, client, client_sources, numerics, numerics_sources, server, sources = built
    assert (sums, client) == ("SHA256SUMS", f"mesh_motion_client-{VERSION}-py3-none-any.whl")
    parts = ("client", "numerics", "server")
    assert [client_sources, numerics_sources, sources] == [f"mesh_motion_{part}-{VERSION}.tar.gz" for part in parts]
    assert server == f"mesh_motion_server-{VERSION}-py3-none-any.whl"
    assert re.fullmatch(rf"mesh_motion_numerics-{VERSION}-(cp3\d+)-\1-.*manylinux_2_\d+_.*\.whl", numerics)
    for line in (ready / "dist" / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split()
        assert hashlib.sha256((ready / "dist" / name).read_bytes()).hexdigest() == digest


def test_builds_that_differ_are_refused(clone: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A seeded fault: a builder that writes the current time into the file."""

    def stamped(root: Path, folder: Path, epoch: str) -> list[Path]:
        (folder / "a.whl").write_text(str(time.time_ns()))
        return [folder / "a.whl"]

    monkeypatch.setattr(release, "build", stamped)
    with pytest.raises(Refused, match=r"two builds must be equal bit for bit, but a\.whl is not"):
        build_twice(clone, tmp_path / "dist")
    assert not (tmp_path / "dist").exists()


def test_the_sums_are_those_that_sha256sum_checks(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"one")
    sums = write_checksums([tmp_path / "a"])
    assert subprocess.run(["sha256sum", "--check", "--quiet", sums.name], cwd=tmp_path, check=False).returncode == 0

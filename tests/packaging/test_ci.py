"""``.ci/run`` chooses its parts; the workflows call parts, targets and Python versions that exist."""

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from bare_environment import ROOT

PARTS = ["system", "kratos", "lint", "tests", "long_tests", "prove", "wheel", "bare", "docs"]
OF_THE_KERNELS = ["c_library", "fuzzed_arguments", "repeated_calls"]
STUDIES = ["studies"]
OF_THE_DISTRIBUTIONS = ["distributions", "extras", "release"]
LONG = [*OF_THE_KERNELS, *STUDIES, *OF_THE_DISTRIBUTIONS]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
STUBS = ("adapters/kratos/environment.sh", "adapters/openfoam/Allwmake", "tools/without_compiler.sh", ".venv/bin/pip",
         ".venv/bin/python", "bin/make", "bin/apt-get")  # fmt: skip


def git(root: Path, *arguments: str) -> None:
    identity = ["-c", "user.name=A", "-c", "user.email=a@b.c"]
    subprocess.run(["git", *identity, *arguments], cwd=root, check=True, capture_output=True)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A branch ``main`` with ``.ci/run``, and replacements of make, apt-get and other programs that do nothing."""
    for name in STUBS:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / ".ci").mkdir()
    (tmp_path / ".ci" / "run").write_bytes((ROOT / ".ci" / "run").read_bytes())
    (tmp_path / "numerics" / "kernels").mkdir(parents=True)
    (tmp_path / "numerics" / "kernels" / "loop.hpp").write_text("")
    git(tmp_path, "init", "-q", "-b", "main")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-qm", "Start")
    return tmp_path


def change(checkout: Path, name: str) -> None:
    git(checkout, "checkout", "-qb", "topic")
    (checkout / name).write_text("changed\n")
    git(checkout, "add", "-A")
    git(checkout, "commit", "-qm", "Change")


def parts_run(checkout: Path, *parts: str, **environment: str) -> list[str]:
    path = f"{checkout / 'bin'}:{os.environ['PATH']}"
    command = ["bash", checkout / ".ci" / "run", *parts]
    given = {"PATH": path, "HOME": str(checkout), **environment}
    done = subprocess.run(command, env=given, capture_output=True, text=True, check=True)
    return re.findall(r"(?m)^== \d\d:\d\d:\d\d (\w+)$", done.stdout)


def test_all_parts_run_where_no_commit_is_there_to_compare_with(checkout: Path) -> None:
    assert parts_run(checkout) == [*PARTS, "end"]
    assert parts_run(checkout, CI_BASE="0" * 40) == [*PARTS, "end"]


def test_long_parts_are_left_out_where_their_files_are_those_of_main(checkout: Path) -> None:
    change(checkout, "page.md")
    assert parts_run(checkout) == [part for part in PARTS if part != "bare"] + ["end"]


@pytest.mark.parametrize(
    ("changed", "run"),
    [
        ("page.md", []),
        ("pyproject.toml", OF_THE_DISTRIBUTIONS),
        ("numerics/numerics.py", ["c_library", *STUDIES]),
        ("numerics/kernels/loop.hpp", LONG),
        (".ci/new", LONG),
    ],
)
def test_tests_of_minutes_are_left_out_where_their_files_are_those_of_main(
    checkout: Path, changed: str, run: list[str]
) -> None:
    (checkout / "bin" / "make").write_text('#!/bin/sh\n[ "$1" != test-all ] || echo "$TESTS" >> options\n')
    change(checkout, changed)
    parts_run(checkout)
    parts_run(checkout, "long_tests")
    others, *chosen, named = (checkout / "options").read_text().splitlines()
    ignored = re.findall(r"--ignore=(\S+)", others)
    assert all((ROOT / name).is_file() for name in ignored)
    assert sorted(Path(name).stem for name in ignored) == sorted(f"test_{name}" for name in LONG)
    assert sorted(named.split()) == sorted(ignored)
    assert sorted(Path(name).stem for name in " ".join(chosen).split()) == sorted(f"test_{name}" for name in run)


def test_a_slow_machine_leaves_them_out_and_says_so(checkout: Path) -> None:
    change(checkout, "numerics/kernels/loop.hpp")
    (checkout / "bin" / "make").write_text('#!/bin/sh\n[ "$1" != test-all ] || exit 3\n')
    assert parts_run(checkout, "long_tests", SECONDS="3100") == ["long_tests", "end"]
    with pytest.raises(subprocess.CalledProcessError):
        parts_run(checkout, "long_tests", SECONDS="2800")


@pytest.mark.parametrize("environment", [{}, {"CI_BASE": "main"}])
def test_a_change_of_the_kernels_runs_all_parts(checkout: Path, environment: dict[str, str]) -> None:
    change(checkout, "numerics/kernels/loop.hpp")
    assert parts_run(checkout, **environment) == [*PARTS, "end"]


def test_parts_that_are_named_run_alone(checkout: Path) -> None:
    change(checkout, "page.md")
    assert parts_run(checkout, "docs", "wheel") == ["docs", "wheel", "end"]


def test_a_part_that_fails_ends_the_run(checkout: Path) -> None:
    (checkout / "bin" / "make").write_text('#!/bin/sh\n[ "$1" != lint ]\n')
    with pytest.raises(subprocess.CalledProcessError) as failed:
        parts_run(checkout)
    assert "tests" not in re.findall(r" (\w+)$", failed.value.stdout, re.MULTILINE)


def test_prove_runs_next_to_later_parts_and_fails_the_run_at_its_end(checkout: Path) -> None:
    wait = "until [ -e docs ]; do sleep 0.01; done; echo a row; exit 1"
    (checkout / "bin" / "make").write_text(f"#!/bin/sh\ncase $1 in docs) touch docs;; prove) {wait};; esac\n")
    with pytest.raises(subprocess.CalledProcessError) as failed:
        parts_run(checkout, "prove", "docs")
    assert failed.value.stdout.splitlines()[-1] == "a row"


def test_prove_ends_with_a_later_part_that_fails(checkout: Path) -> None:
    (checkout / "bin" / "make").write_text('#!/bin/sh\n[ "$1" = prove ] || exit 3\nexec sleep 600\n')
    with pytest.raises(subprocess.CalledProcessError) as failed:
        parts_run(checkout, "prove", "docs")
    assert failed.value.returncode == 3


def test_a_wrong_part_is_refused(checkout: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError) as failed:
        parts_run(checkout, "docs", "doc")
    assert failed.value.stderr == f"there is no part 'doc'; parts are: {' '.join(PARTS)}\n"


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_calls_what_is_there(workflow: Path) -> None:
    text = workflow.read_text()
    assert set(" ".join(re.findall(r"run: \.ci/run (.+)", text)).split()) <= set(PARTS)
    targets = re.findall(r"(?m)^([\w-]+):", (ROOT / "Makefile").read_text())
    assert set(" ".join(re.findall(r"run: make (.+)", text)).split()) <= set(targets)


def test_each_supported_python_is_tested() -> None:
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    supported = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    assert supported
    assert set(re.findall(r'(?:container: python:|")(3\.\d+)', text)) == set(supported)

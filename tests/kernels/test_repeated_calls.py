"""Recorded calls of all loops, repeated by programs without Python: on another processor, and with sanitizers."""

import os
import sys
from pathlib import Path

import pytest
from programs import need, run

HERE = Path(__file__).parent
CROSS = {"C": "aarch64-linux-gnu-gcc", "CXX": "aarch64-linux-gnu-g++"}
#: How the program is built and started, and the tools for it. The loops run on three threads.
BUILDS = {
    "aarch64": (
        ["-DCMAKE_SYSTEM_NAME=Linux", "-DCMAKE_SYSTEM_PROCESSOR=aarch64"]
        + [f"-DCMAKE_{language}_COMPILER={compiler}" for language, compiler in CROSS.items()],
        ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"],
        ["qemu-aarch64", *CROSS.values()],
    ),
    "addresses": (["-DMESH_MOTION_SANITIZE=address,undefined"], [], ["c++"]),
    "threads": (["-DMESH_MOTION_SANITIZE=thread"], [], ["c++"]),
}
FIRST_FAULT_ENDS = {f"{sanitizer}_OPTIONS": "halt_on_error=1" for sanitizer in ("ASAN", "UBSAN", "TSAN")}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The file with the calls, and their number."""
    file = tmp_path_factory.mktemp("recorded") / "calls"
    lines = [line.split("\t") for line in run(sys.executable, HERE / "recorded_calls.py", file).splitlines()]
    assert all(int(calls) for _, _, calls in lines), "a loop is never called"
    assert sum(used != "0" for _, used, _ in lines) > 0.8 * len(lines)
    return file, sum(int(calls) for _, _, calls in lines)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("build", BUILDS)
def test_repeated_calls_have_the_same_bits(tmp_path: Path, recorded: tuple[Path, int], build: str) -> None:
    options, start, tools = BUILDS[build]
    need("cmake", *tools)
    run("cmake", "-S", HERE / "replay", "-B", tmp_path, *options)
    run("cmake", "--build", tmp_path, "-j", 2)
    environment = os.environ | FIRST_FAULT_ENDS | {"MESH_MOTION_THREADS": "3"}
    with recorded[0].open("rb") as calls:
        found = run(*start, tmp_path / "replay", stdin=calls, env=environment).splitlines()
    assert len(found) == recorded[1]
    assert [line for line in found if not line.endswith("\tsame")] == []

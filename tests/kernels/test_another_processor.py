"""Loops have the same bits on aarch64, whose calls are repeated in an emulator."""

import sys
from pathlib import Path

import pytest
from programs import need, run

HERE = Path(__file__).parent
COMPILERS = {"C": "aarch64-linux-gnu-gcc", "CXX": "aarch64-linux-gnu-g++"}
EMULATOR = "qemu-aarch64"


def counts(lines: str) -> dict[str, tuple[int, int]]:
    return {name: (int(used), int(calls)) for name, used, calls in (line.split("\t") for line in lines.splitlines())}


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_loops_have_the_same_bits_on_another_processor(tmp_path: Path) -> None:
    need("cmake", EMULATOR, *COMPILERS.values())
    chosen = [f"-DCMAKE_{language}_COMPILER={compiler}" for language, compiler in COMPILERS.items()]
    system = ["-DCMAKE_SYSTEM_NAME=Linux", "-DCMAKE_SYSTEM_PROCESSOR=aarch64"]
    run("cmake", "-S", HERE / "replay", "-B", tmp_path, *system, *chosen)
    run("cmake", "--build", tmp_path, "-j", 2)
    recorded = counts(run(sys.executable, HERE / "recorded_calls.py", tmp_path / "calls"))
    assert all(calls for _, calls in recorded.values()), "a loop is never called"
    assert sum(used > 0 for used, _ in recorded.values()) > 0.8 * len(recorded)
    with (tmp_path / "calls").open("rb") as calls:
        found = run(EMULATOR, "-L", "/usr/aarch64-linux-gnu", tmp_path / "replay", stdin=calls).splitlines()
    assert len(found) == sum(calls for _, calls in recorded.values())
    assert [line for line in found if not line.endswith("\tsame")] == []

"""A move has the same bits on any number of threads and at any vector width."""

import functools
import os
from pathlib import Path

import mesh_motion_kernels as kernels
import pytest
from python_runs import said_by_python

from mesh_motion_server.transport.processes import repeatable_libraries

_SCRIPT = Path(__file__).with_name("moves.py")
_BUILT = sorted(found.parent.name for found in Path(kernels.__file__).parent.glob("*/_kernels*"))
#: The levels that are built and run on this machine.
LEVELS = [level for level in _BUILT if level <= kernels._widest()]


@functools.cache
def _digests(level: str) -> dict[tuple[str, str], str]:
    """Digests by case and threads, from a separate process with the same libraries as a worker."""
    chosen = {"MESH_MOTION_LEVEL": level, "MESH_MOTION_THREADS": "3"} | repeatable_libraries()
    lines = [line.split("\t") for line in said_by_python(_SCRIPT, env=os.environ | chosen).splitlines()]
    return {(case, threads): digest for case, threads, digest in lines}


@pytest.fixture(scope="module")
def expected() -> dict[str, str]:
    return {case: digest for (case, threads), digest in _digests(LEVELS[0]).items() if threads == "1"}


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_moves_have_the_same_bits(level: str, expected: dict[str, str]) -> None:
    found = _digests(level)
    assert len(found) == 3 * len(expected) > 0
    differing = [f"{case}, {threads} threads" for (case, threads), digest in found.items() if digest != expected[case]]
    assert not differing

"""Records calls of loops, with their results and the arrays that they wrote, for ``replay``.

``python recorded_calls.py FILE`` prints for each loop the number of calls from moves and tests, and the number of all
calls.
"""

import struct
import sys
from collections import Counter
from contextlib import redirect_stdout, suppress
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import mesh_motion_kernels as kernels
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import fuzz
import moves

#: Programs that call loops with real data: moves, and tests of rare branches of moves.
_CASES = ("2D sparse", "2D corrected", "2D maximum", "2D reduced", "3D mixed", "3D two scales")
_TESTS = (
    "factorizations/test_iterative.py",
    "../distributed/test_counted_cells.py", "../distributed/test_field.py",
    "../session/partitions/test_cell_order.py", "../session/partitions/test_exact_displacements.py",
    "../docs/studies/test_sampled_prediction.py",
    "../docs/studies/volume_reduction/test_background_grid.py",
    "test_centres.py", "test_closest_point.py", "test_contact_ahead.py", "test_evaluation.py",
    "test_hashed_cells.py", "test_headroom.py", "test_linked_unknowns.py",
    "test_sliding.py", "test_newton.py", "test_cell_distortion.py", "test_smooth_motion.py", "test_motion_slope.py",
    "../docs/studies/test_predictors.py", "two_scale/test_grid_sums.py", "two_scale/test_nested_grid.py",
)  # fmt: skip
#: Moves with so many times the boxes along each axis: loops have the work of several tasks.
_FINER = {"2D corrected": 6, "3D corrected": 4}
#: Of each loop so many forms of calls are kept, none longer than so many bytes; so many of fuzzing; and the longest
#: call that has no more than so many bytes: several threads share its work.
_FORMS, _BYTES, _FUZZED, _LONGEST = 20, 2_000_000, 20, 16_000_000
LOOPS = sorted(set(fuzz.loops()) - {"available_threads", "get_threads", "set_threads"})


def _text(text: bytes) -> bytes:
    return struct.pack("<q", len(text)) + text


def _value(value: Any) -> bytes:
    """An argument or a result: its kind, then its parts."""
    if value is None:
        return b"-"
    if isinstance(value, np.ndarray):
        shape = struct.pack(f"<{value.ndim + 1}q", value.ndim, *value.shape)
        return b"a" + _text(value.dtype.str[1:].encode()) + shape + _text(value.tobytes())
    if isinstance(value, tuple | list):
        return b"s" + struct.pack("<q", len(value)) + b"".join(map(_value, value))
    return b"n" + struct.pack("<d", value)


def _bytes(arguments: Any) -> int:
    if isinstance(arguments, tuple | list):
        return sum(map(_bytes, arguments))
    return int(getattr(arguments, "nbytes", 8))


def _form(arguments: Any) -> Any:
    """The properties that distinguish calls: types, whole numbers and the length of rows."""
    if isinstance(arguments, np.ndarray):
        return arguments.dtype, arguments.shape[1:]
    return tuple(map(_form, arguments)) if isinstance(arguments, tuple | list) else str(arguments)[:2]


class Recorder:
    """Writes calls of loops that succeed, and counts them by loop."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.calls: Counter[str] = Counter()
        self._forms: set[Any] = set()
        self._longest: dict[str, tuple[int, tuple[Any, ...]]] = {}
        self.loops = {name: getattr(kernels, name) for name in LOOPS}

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        before = _value(arguments)
        result = self.loops[name](*arguments)
        self.file.write(_text(name.encode()) + before + _value(result) + _value(arguments))
        self.calls[name] += 1
        return result

    def of_use(self) -> None:
        for name in LOOPS:
            setattr(kernels, name, partial(self._used, name))
        for case in _CASES:
            moves.moved(case)
        numerics = Path(__file__).parents[1] / "numerics"
        options = ["-q", "-p", "no:xdist", "-p", "no:cacheprovider", "-m", "not slow"]
        with redirect_stdout(sys.stderr):
            assert pytest.main([*options, *(str(numerics / test) for test in _TESTS)]) == 0

    def _used(self, name: str, *arguments: Any) -> Any:
        form, size = (name, _form(arguments)), _bytes(arguments)
        if self._longest.get(name, (0,))[0] < size <= _LONGEST:
            self._longest[name] = size, deepcopy(arguments)
        if form in self._forms or self.calls[name] == _FORMS or size > _BYTES:
            return self.loops[name](*arguments)
        self._forms.add(form)
        return self.call(name, arguments)

    def of_length(self) -> None:
        for case, finer in _FINER.items():
            moves.moved(case, finer)
        for name, (_, arguments) in self._longest.items():
            self.call(name, arguments)

    def of_fuzzing(self) -> None:
        rng = np.random.default_rng(0)
        for name in LOOPS:
            for expected in fuzz.overloads(self.loops[name]):
                for _ in range(_FUZZED):
                    arguments, _ = fuzz.drawn(expected, rng)
                    with suppress(ValueError):
                        self.call(name, tuple(arguments))


if __name__ == "__main__":
    with Path(sys.argv[1]).open("wb") as file:
        recorder = Recorder(file)
        recorder.of_use()
        recorder.of_length()
        used = recorder.calls.copy()
        recorder.of_fuzzing()
    for loop in LOOPS:
        sys.stdout.write(f"{loop}\t{used[loop]}\t{recorder.calls[loop]}\n")

"""Calls loops with any arguments from Python: ``python fuzz.py TRIALS NAME …`` prints a line for each loop.

A loop gives a result, a TypeError or a ValueError. Arrays lie in the middle of larger ones: a write outside them is
detected there, and an invalid index from there points far away, which ends the process.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import mesh_motion_kernels as kernels
import numpy as np

_MARGIN = 64  # numbers before and after an array
_NEVER = 0.1  # share of whole numbers that are not an index, in half of the arrays
_ARRAY = re.compile(r"ndarray\[dtype=(\w+), shape=\(([^)]*)\)")
_SEVERAL = re.compile(r"(tuple|collections\.abc\.Sequence)\[(.*)\]$")


class Parameter(NamedTuple):
    """A parameter of a loop: an array with its type, axes and whether it is written to, a scalar, or several of them in
    a tuple or list.
    """

    kind: str
    axes: int = 0
    written: bool = False
    inner: tuple[Parameter, ...] = ()


class Guarded(NamedTuple):
    """An array, and a copy of the larger one around it."""

    array: np.ndarray
    around: np.ndarray
    before: bytes


def loops() -> list[str]:
    return sorted(name for name, found in vars(kernels).items() if hasattr(found, "__nb_signature__"))


def overloads(loop: Any) -> list[list[Parameter]]:
    """The parameters of each form of a loop, from the signatures in the binding."""
    texts = [signature[0].partition("(")[2].rpartition(") ->")[0] for signature in loop.__nb_signature__]
    return [[_parameter(arg.partition(": ")[2]) for arg in _split(text) if arg != "/"] for text in texts]


def _split(text: str) -> list[str]:
    """Split at the commas outside of brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "[(") - (letter in "])")
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def _parameter(text: str) -> Parameter:
    if array := _ARRAY.match(text):
        return Parameter(array[1], array[2].count("*"), "writable=False" not in text)
    if several := _SEVERAL.match(text):
        return Parameter(several[1], inner=tuple(_parameter(part) for part in _split(several[2])))
    return Parameter(text)


def filled(shape: tuple[int, ...], dtype: str, rng: np.random.Generator) -> Guarded:
    """An array of reals, or of whole numbers, between numbers that cannot be an index."""
    kind, size = np.dtype(dtype), int(np.prod(shape))
    margin: Any = np.nan if kind.kind == "f" else True if kind.kind == "b" else far_away(kind)
    around = np.full(size + 2 * _MARGIN, margin, dtype=kind)
    array = around[_MARGIN : _MARGIN + size].reshape(shape)
    array[...] = rng.normal(size=shape) if kind.kind == "f" else whole_numbers(shape, kind, rng)
    return Guarded(array, around, _outside(around))


def no_indices(kind: np.dtype[Any]) -> np.ndarray:
    """Whole numbers that are never a valid index."""
    ends = np.iinfo(kind)
    return np.array([-1, ends.min, ends.max, -far_away(kind), far_away(kind)]).astype(kind)


def far_away(kind: np.dtype[Any]) -> int:
    """An index outside the memory of the process, for any size of a row."""
    return 2 ** (40 if kind.itemsize == 8 else 30)


def whole_numbers(shape: tuple[int, ...], kind: np.dtype[Any], rng: np.random.Generator) -> np.ndarray:
    """Zeros, which are valid indices; small numbers, of which some are valid; or these with a few that never are."""
    numbers = rng.integers(0, rng.choice([1, 2, 4]), size=shape).astype(kind)
    if kind.kind != "b" and rng.integers(2):
        numbers = np.where(rng.random(shape) < _NEVER, rng.choice(no_indices(kind), size=shape), numbers)
    return numbers


def _outside(around: np.ndarray) -> bytes:
    return around[:_MARGIN].tobytes() + around[-_MARGIN:].tobytes()


def scalar(kind: str, rng: np.random.Generator) -> Any:
    values: dict[str, list[Any]] = {
        "bool": [False, True],
        "int": [-1, 0, 1, 2, 3, 7],
        "float": [0.0, 0.5, 1.0, -1.0, np.nan, np.inf],
    }
    return values[kind][rng.integers(len(values[kind]))]


def drawn(expected: list[Parameter], rng: np.random.Generator) -> tuple[list[Any], list[Guarded]]:
    """Arguments of the right types. Few sizes are used at a time, so that some shapes match and some do not."""
    sizes = rng.choice([0, 1, 2, 3, 4, 5, 8], size=2)
    guarded: list[Guarded] = []

    def value(parameter: Parameter) -> Any:
        if parameter.axes:
            guarded.append(filled(tuple(int(n) for n in rng.choice(sizes, parameter.axes)), parameter.kind, rng))
            return guarded[-1].array
        if parameter.kind == "tuple":
            return tuple(map(value, parameter.inner))
        if parameter.inner:
            return [value(parameter.inner[0]) for _ in range(rng.integers(4))]
        return scalar(parameter.kind, rng)

    return [value(parameter) for parameter in expected], guarded


def shown(value: Any) -> Any:
    return type(value)(map(shown, value)) if isinstance(value, list | tuple) else getattr(value, "shape", value)


def wrong(parameter: Parameter) -> Iterator[Any]:
    yield None
    yield "text"
    if not parameter.axes:
        yield [1]
        yield [None] if parameter.inner else ()
        return
    axes, kind = parameter.axes, parameter.kind
    array = np.zeros((3,) * axes, dtype=kind)
    yield 1.0
    yield array.tolist()
    for other in ("float32", "float64", "int16", "int32", "int64", "uint64", "bool", "complex128"):
        if other != kind:
            yield array.astype(other)
    yield array[0]
    yield array[None]
    yield array[::-1]
    yield np.repeat(array, 2, axis=0)[::2]
    yield np.repeat(array, 2, axis=-1)[..., ::2]
    if axes > 1:
        yield array.T
    if array.itemsize > 1:
        yield array.view(array.dtype.newbyteorder())
    if parameter.written:
        array.flags.writeable = False
        yield array


def refused(name: str, arguments: list[Any]) -> bool:
    try:
        getattr(kernels, name)(*arguments)
    except TypeError:
        return True
    return False


def fuzz(name: str, trials: int) -> str:
    """Fault of a loop, if any, after this number of calls with arrays of the right kinds."""
    rng, forms = np.random.default_rng(0), overloads(getattr(kernels, name))
    for expected in forms:
        for _ in range(trials):
            arguments, guarded = drawn(expected, rng)
            try:
                getattr(kernels, name)(*arguments)
            except (TypeError, ValueError):
                pass
            except Exception as error:
                return f"{error!r} of {shown(arguments)}"
            if any(_outside(each.around) != each.before for each in guarded):
                return f"writes outside of arrays of {shown(arguments)}"
        for place, parameter in enumerate(expected):
            kinds = {form[place].kind for form in forms if len(form) > place} - {parameter.kind}
            for value in wrong(parameter):
                if str(getattr(value, "dtype", None)) in kinds:
                    continue
                arguments, _ = drawn(expected, rng)
                arguments[place] = value
                if not refused(name, arguments):
                    return f"takes {type(value).__name__} {getattr(value, 'dtype', value)} as argument {place}"
        arguments, _ = drawn(expected, rng)
        if not refused(name, [*arguments, 0]) or (arguments and not refused(name, arguments[:-1])):
            return "takes another number of arguments"
    return ""


if __name__ == "__main__":
    for each in sys.argv[2:]:
        sys.stdout.write(f"{each}\t{fuzz(each, int(sys.argv[1]))}\n")
        sys.stdout.flush()

"""Calls loops with whatever may come from Python; ``python fuzz.py NAME …`` prints a line for each that gets through.

A loop gives a result, a TypeError or a ValueError. Arrays lie in the middle of larger ones: what is written beside them
is found there, and an index that is read there leads far away, which ends the process.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import mesh_motion_kernels as kernels
import numpy as np

TRIALS = 300
_BESIDE = 64  # numbers before and after an array
_ARRAY = re.compile(r"ndarray\[dtype=(\w+), shape=\(([^)]*)\)[^\]]*\]")


class Parameter(NamedTuple):
    """What a loop expects: an array of a type, axes and perhaps written to, or a scalar."""

    kind: str
    axes: int = 0
    written: bool = False


class Guarded(NamedTuple):
    """An array, and the larger one around it as it was."""

    array: np.ndarray
    around: np.ndarray
    before: bytes


def loops() -> list[str]:
    """Names of the functions of the extension."""
    return sorted(name for name, found in vars(kernels).items() if hasattr(found, "__nb_signature__"))


def parameters(name: str) -> list[Parameter]:
    """From the signature that the binding tells."""
    [(signature, *_)] = getattr(kernels, name).__nb_signature__
    inside = signature.partition("(")[2].rpartition(") ->")[0]
    found = []
    for text in re.findall(r"arg\d*: ((?:[^\[,]|\[[^\]]*\])+)", inside):
        array = _ARRAY.match(text)
        found.append(
            Parameter(array[1], array[2].count("*"), "writable=False" not in text) if array else Parameter(text.strip())
        )
    return found


def filled(shape: tuple[int, ...], dtype: str, rng: np.random.Generator) -> Guarded:
    """An array of zeros, or reals, between numbers that nobody can take for an index."""
    kind, size = np.dtype(dtype), int(np.prod(shape))
    beside: Any = np.nan if kind.kind == "f" else True if kind.kind == "b" else np.iinfo(kind).max // 4
    around = np.full(size + 2 * _BESIDE, beside, dtype=kind)
    array = around[_BESIDE : _BESIDE + size].reshape(shape)
    array[...] = rng.normal(size=shape) if kind.kind == "f" else 0
    return Guarded(array, around, _outside(around))


def _outside(around: np.ndarray) -> bytes:
    return around[:_BESIDE].tobytes() + around[-_BESIDE:].tobytes()


def scalar(kind: str, rng: np.random.Generator) -> Any:
    """A value of a scalar parameter."""
    values: dict[str, list[Any]] = {
        "bool": [False, True],
        "int": [-1, 0, 1, 2, 3, 7],
        "float": [0.0, 0.5, 1.0, -1.0, np.nan, np.inf],
    }
    return values[kind][rng.integers(len(values[kind]))]


def drawn(expected: list[Parameter], rng: np.random.Generator) -> tuple[list[Any], list[Guarded]]:
    """Arguments of the right types. Few sizes are used at a time, so that some shapes match and some do not."""
    sizes = rng.choice([0, 1, 2, 3, 4, 5, 8], size=3)
    guarded, arguments = [], []
    for parameter in expected:
        if parameter.axes:
            shape = tuple(int(n) for n in rng.choice(sizes, size=parameter.axes))
            guarded.append(filled(shape, parameter.kind, rng))
            arguments.append(guarded[-1].array)
        else:
            arguments.append(scalar(parameter.kind, rng))
    return arguments, guarded


def wrong(parameter: Parameter) -> Iterator[Any]:
    """What never is such an argument."""
    yield None
    yield "text"
    if not parameter.axes:
        yield [1]
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
    """Whether it is a TypeError."""
    try:
        getattr(kernels, name)(*arguments)
    except TypeError:
        return True
    return False


def fuzz(name: str) -> str:
    """What is wrong with a loop, if anything is."""
    rng, expected = np.random.default_rng(0), parameters(name)
    unknown = {p.kind for p in expected if not p.axes} - {"bool", "int", "float"}
    if unknown:
        return f"no values are known for {unknown}"
    for _ in range(TRIALS):
        arguments, guarded = drawn(expected, rng)
        shapes = [found.shape if isinstance(found, np.ndarray) else found for found in arguments]
        try:
            getattr(kernels, name)(*arguments)
        except (TypeError, ValueError):
            pass
        except Exception as error:
            return f"{error!r} of {shapes}"
        if any(_outside(each.around) != each.before for each in guarded):
            return f"writes beside arrays of {shapes}"
    for place, parameter in enumerate(expected):
        for value in wrong(parameter):
            arguments, _ = drawn(expected, rng)
            arguments[place] = value
            if not refused(name, arguments):
                return f"takes {type(value).__name__} {getattr(value, 'dtype', value)} as argument {place}"
    arguments, _ = drawn(expected, rng)
    if not refused(name, [*arguments, 0]) or (arguments and not refused(name, arguments[:-1])):
        return "takes another number of arguments"
    return ""


if __name__ == "__main__":
    for each in sys.argv[1:]:
        sys.stdout.write(f"{each}\t{fuzz(each)}\n")
        sys.stdout.flush()

"""Figures that asv tracks: some of ``make bench-quick``, measured by the same functions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from benchmarks.correction import cost
from benchmarks.correction.cases import CASES as CORRECTIONS
from benchmarks.correction.cost import Cost
from benchmarks.peers.meshes import load_or_build
from benchmarks.scale import library
from benchmarks.scale.cases import CASES
from benchmarks.scale.figures import Figures

_MESHES = Path(__file__).resolve().parents[2] / "out" / "meshes"
_REPEAT = 3

Found = TypeVar("Found")


def _unit(unit: str) -> Callable[[Any], Any]:
    """asv reads a figure's unit from an attribute of its function."""

    def mark(track: Any) -> Any:
        track.unit = unit
        return track

    return mark


class _Measured(Generic[Found]):
    """Measures each case once for all its figures."""

    param_names = ("case",)
    timeout = 600.0
    params: tuple[str, ...]

    def measured(self, case: str) -> Found:
        """In this process."""
        raise NotImplementedError

    def setup_cache(self) -> dict[str, Found]:
        """Runs first, in a separate process."""
        _MESHES.mkdir(parents=True, exist_ok=True)
        return {case: self.measured(case) for case in self.params}


class Motion(_Measured[Figures]):
    """Steady steps in the library."""

    params = ("M2-steady", "M3-steady", "W3-steady")

    def measured(self, case: str) -> Figures:
        load_or_build(CASES[case].mesh, _MESHES)
        return library.measured(CASES[case], _MESHES, _REPEAT)

    @_unit("s")
    def track_setup(self, found: dict[str, Figures], case: str) -> float:
        return found[case].setup.cpu

    @_unit("s")
    def track_step(self, found: dict[str, Figures], case: str) -> float:
        return found[case].step.cpu

    @_unit("s")
    def track_later_iteration(self, found: dict[str, Figures], case: str) -> float:
        return found[case].brief.cpu

    @_unit("bytes a node")
    def track_peak_memory(self, found: dict[str, Figures], case: str) -> float:
        return found[case].peak_bytes / found[case].nodes

    @_unit("of the largest displacement")
    def track_boundary_error(self, found: dict[str, Figures], case: str) -> float:
        return found[case].boundary_error


class Correction(_Measured[Cost]):
    """Corrections of a large motion."""

    params = ("M2-0.20", "M3-0.28")

    def measured(self, case: str) -> Cost:
        return cost.measured(CORRECTIONS[case], _MESHES, _REPEAT)

    @_unit("s")
    def track_correction(self, found: dict[str, Cost], case: str) -> float:
        return found[case].cpu_seconds

    @_unit("size-skew")
    def track_minimum(self, found: dict[str, Cost], case: str) -> float:
        return found[case].minimum

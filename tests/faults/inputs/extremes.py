"""Inputs that are unusual but valid: each must be accepted, and the answer must be as exact as its row says."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.faults.inputs.drafts import Draft, Part, Rows

#: Scaling by a power of ten rounds every coordinate; so far results may differ, relative to the largest one.
_ROUNDED = 1e-9


@dataclass(frozen=True, eq=False)
class Outcome:
    """The answers of a session.

    ``displacement`` (n, d) array; ``prescribed`` (k, d) array: of the moving nodes; ``moving`` (k,) array; ``quality``:
    the summary of the moved mesh; ``warnings``: of BUILT.
    """

    displacement: NDArray[np.float64]
    prescribed: NDArray[np.float64]
    moving: NDArray[np.int64]
    quality: dict[str, Any]
    warnings: list[str]


#: Says what is wrong about an outcome, next to that of the good session; "" if nothing is.
Judge = Callable[[Outcome, Outcome], str]


@dataclass(frozen=True)
class Extreme:
    """One row: the change of the good draft, and the check of the result."""

    name: str
    change: Callable[[Draft], Any]
    judge: Judge
    draft: str = "square"


# --- judges ----------------------------------------------------------------------------------------------------------


def _taken(got: Outcome, good: Outcome) -> str:
    """Only acceptance is checked: the runner compares the moving nodes with their displacements in any case."""
    return ""


def _same_bits(got: Outcome, good: Outcome) -> str:
    return "" if got.displacement.tobytes() == good.displacement.tobytes() else "expected the same bits"


def _like(factor: float, tolerance: float = _ROUNDED) -> Judge:
    """The good session's displacements times a factor, and its quality."""

    def judge(got: Outcome, good: Outcome) -> str:
        away = np.abs(got.displacement / factor - good.displacement).max() / np.abs(good.displacement).max()
        apart = max(abs(got.quality[k]["min"] - good.quality[k]["min"]) for k in ("size", "skew", "metric"))
        if away <= tolerance and apart <= tolerance:
            return ""
        return f"displacements differ by {away:.2g}, quality by {apart:.2g}; expected {tolerance:.0e}"

    return judge


def _all_prescribed(got: Outcome, good: Outcome) -> str:
    """Every node moves, so every node has its prescribed position."""
    return (
        ""
        if got.displacement.tobytes() == got.prescribed.tobytes()
        else "expected the prescribed values, to the last bit"
    )


def _unmoved(got: Outcome, good: Outcome) -> str:
    return "" if not got.displacement.any() else f"expected no motion, got {np.abs(got.displacement).max()}"


def _tiny(got: Outcome, good: Outcome) -> str:
    """No node moves further than the prescribed displacement, and all cells keep size 1."""
    if np.abs(got.displacement).max() > 2 * np.abs(got.prescribed).max():
        return f"expected tiny displacements, got {np.abs(got.displacement).max()}"
    return "" if abs(got.quality["size"]["min"] - 1.0) <= 1e-12 else f"expected size 1, got {got.quality['size']}"


def _warned(*texts: str) -> Judge:
    def judge(got: Outcome, good: Outcome) -> str:
        found = [w for w in got.warnings if all(text in w for text in texts)]
        return "" if found else f"expected a warning with {texts}, got {got.warnings}"

    return judge


def _rigid(motion: Callable[[Any], Any], points: Callable[[], Any], tolerance: float) -> Judge:
    def judge(got: Outcome, good: Outcome) -> str:
        places = points()
        expected = motion(places) - places
        away = float(np.abs(got.displacement - expected).max() / np.abs(expected).max())
        return "" if away <= tolerance else f"expected a rigid motion to {tolerance:.0e}, got {away:.2g}"

    return judge


# --- changes ---------------------------------------------------------------------------------------------------------


def _scale(factor: float) -> Callable[[Draft], Any]:
    return lambda draft: [np.multiply(array, factor, out=array) for array in (draft.points, draft.moved)]


def _shift(offset: float) -> Callable[[Draft], Any]:
    return lambda draft: np.add(draft.points, offset, out=draft.points)


def _displaced_by(value: float) -> Callable[[Draft], Any]:
    return lambda draft: draft.moved.fill(value)


def _settings(**settings: Any) -> Callable[[Draft], Any]:
    return lambda draft: draft.set_settings(**settings)


def _narrow_indices(draft: Draft) -> None:
    for part in draft.parts[0]:
        if part.item != "nodes":
            part.rows = Rows(part.rows.values.astype(np.int32))


def _row_by_row(draft: Draft) -> None:
    draft.parts[0] = [
        Part(part.item, part.name, part.role, Rows(part.rows.values[i : i + 1]))
        for part in draft.parts[0]
        for i in range(len(part.rows.values))
    ]


def _empty_parts(draft: Draft) -> None:
    empty = [Part(p.item, p.name, p.role, Rows(p.rows.values[:0])) for p in draft.parts[0]]
    draft.parts[0] = [*empty, *draft.parts[0], *empty]


def _all_moving(draft: Draft) -> None:
    draft.drop("patch", "walls")
    draft.replace("patch", "left", np.arange(25)[:, None])
    draft.displacement[0] = Rows(0.02 * np.sin(7 * draft.points))


def _smallest(draft: Draft) -> None:
    draft.parts[0] = []
    draft.parts[0].append(Part("nodes", "", "", Rows(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))))
    draft.parts[0].append(Part("cells", "triangle", "", Rows(np.array([[0, 1, 2]]))))
    draft.add_patch("left", "moving", [0])
    draft.add_patch("walls", "fixed", [1, 2])
    draft.displacement[0] = Rows(np.array([[0.1, -0.2]]))


def _two_domains(draft: Draft) -> None:
    """A second, separate square with free nodes only."""
    cells = draft.rows("cells", "triangle")
    draft.replace("nodes", "", np.concatenate([draft.points, draft.points + np.array([5.0, 0.0])]))
    draft.replace("cells", "triangle", np.concatenate([cells, cells + 25]))


def _ids(draft: Draft) -> None:
    ids = np.linspace(-1.0, 1.0, 25) * 2.0**62
    ids = ids.astype(np.int64)
    ids[0], ids[-1] = -(2**63), 2**63 - 1
    draft.parts[0].append(Part("global_ids", "", "", Rows(ids[:, None])))


def _flattened(draft: Draft) -> None:
    """Cells of aspect ratio 10⁶, as in a boundary layer."""
    draft.points[:, 1] *= 1e-6
    draft.moved[:] *= 1e-6


def _carried(motion: Callable[[Any], Any]) -> Callable[[Draft], None]:
    """No node is fixed; the moving side makes a rigid motion."""

    def change(draft: Draft) -> None:
        draft.drop("patch", "walls")
        left = draft.points[::5]
        draft.displacement[0] = Rows(motion(left) - left)

    return change


def _far(points: Any) -> Any:
    return points + np.array([1e6, -2e6])


def _turned(points: Any) -> Any:
    return (points - 0.5) @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + 3.0


def _grid() -> Any:
    axis = np.linspace(0.0, 1.0, 5)
    return np.array([[x, y] for y in axis for x in axis])


EXTREMES = (
    *(Extreme(f"square × {f:g}", _scale(f), _like(f)) for f in (1e6, 1e-6, 1e12, 1e-11)),
    *(Extreme(f"cube × {f:g}", _scale(f), _like(f), "cube") for f in (1e6, 1e-6, 1e12, 1e-12)),
    *(Extreme(f"square + {o:g}", _shift(o), _like(1.0, 1e-8)) for o in (1e6, -1e6)),
    Extreme("cube + 1e6", _shift(1e6), _like(1.0, 1e-8), "cube"),
    Extreme("square + 1e12", _shift(1e12), _like(1.0, 1e-2)),
    *(Extreme(f"displacement {v:g}", _displaced_by(v), _tiny) for v in (5e-324, -5e-324, 1e-310, 1e-200)),
    *(Extreme(f"displacement {v}", _displaced_by(v), _unmoved) for v in (0.0, -0.0)),
    Extreme("no displacement in 3D", _displaced_by(0.0), _unmoved, "cube"),
    Extreme(
        "coordinates in single precision", lambda d: d.replace("nodes", "", d.points.astype(np.float32)), _same_bits
    ),
    Extreme("indices of 4 bytes", _narrow_indices, _same_bits),
    Extreme("a part for each row", _row_by_row, _same_bits),
    Extreme("parts without rows", _empty_parts, _same_bits),
    Extreme("a patch twice", lambda draft: draft.parts[0].append(draft.part("patch", "walls")), _same_bits),
    Extreme(
        "patches that overlap",
        lambda d: d.add_patch("all", "fixed", np.arange(5) * 5),
        _warned("share 5 nodes", "moving wins"),
    ),
    Extreme("all nodes move", _all_moving, _all_prescribed),
    Extreme("a single cell", _smallest, _taken),
    Extreme(
        "a node in no cell",
        lambda d: d.replace("nodes", "", np.append(d.points, [[0.4, 0.4]], axis=0)),
        _warned("no cell", "node 25"),
    ),
    Extreme("two domains", _two_domains, _warned("in no patch", "node 25")),
    Extreme("global ids at the ends of 64 bits", _ids, _same_bits),
    Extreme("subnormal coordinates", lambda d: np.putmask(d.points, d.points == 0.0, 5e-324), _like(1.0, 1e-12)),
    Extreme("aspect ratio 10⁶", _flattened, _taken),
    Extreme(
        "a name of any characters", lambda d: setattr(d.part("patch", "left"), "name", "Gehäuse/左\0'\";--"), _same_bits
    ),
    Extreme("a support radius below all spacings", _settings(support_radius=1e-11), _taken),
    Extreme("carried far away", _carried(_far), _rigid(_far, _grid, 1e-12)),
    Extreme("turned by 90°", _carried(_turned), _rigid(_turned, _grid, 1e-12)),
)

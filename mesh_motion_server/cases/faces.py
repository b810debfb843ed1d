"""Face quality for finite-volume solvers: the values of MOVED's faces that a run keeps, and the last line of play."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

#: Face values that are columns of steps.csv.
FACES = (
    *("max_non_orthogonality", "faces_above_65", "faces_above_75", "max_skewness", "min_volume_ratio"),
    *("shortest_edge", "smallest_face"),
)

Faces = Mapping[str, Mapping[str, Any]]


def faces_numbers(faces: Faces) -> dict[str, dict[str, Any]]:
    """The values kept of MOVED's faces; of the list of worst faces only the first one, after the step."""
    kept = {name: {key: value for key, value in numbers.items() if key != "worst"} for name, numbers in faces.items()}
    if "after" in kept:
        kept["after"]["worst"] = list(faces["after"].get("worst", ()))[:1]
    return kept


def faces_line(steps: Sequence[Faces]) -> str:
    """The faces of all steps of a run (first to last) in one line; empty if unknown.

    The number of faces above a limit is that of the step with the least orthogonal face; other values are the worst of
    all steps.
    """
    known = {number: step for number, step in enumerate(steps, start=1) if step}
    if not known:
        return ""
    rest = next(iter(known.values()))["before"]
    after = {number: step["after"] for number, step in known.items()}
    worst = max(after, key=lambda number: float(after[number]["max_non_orthogonality"]))
    most = after[worst]
    skewness = max(float(numbers["max_skewness"]) for numbers in after.values())
    ratio = min(float(numbers["min_volume_ratio"]) for numbers in after.values())
    where = f" in step {worst}" if len(steps) > 1 else ""
    return (
        f"non-orthogonality at most {most['max_non_orthogonality']:.1f}°{where} "
        f"({rest['max_non_orthogonality']:.1f}° at rest), {_above(most)}; skewness at most {skewness:.2f} "
        f"({rest['max_skewness']:.2f}), volume ratio at least {ratio:.2f} ({rest['min_volume_ratio']:.2f})"
        f"{_shrunk(after.values())}"
    )


def _shrunk(after: Iterable[Mapping[str, Any]]) -> str:
    """The smallest edge and face of all steps; in 2D they are equal; empty if the server does not report them."""
    sizes = [(float(now["shortest_edge"]), float(now["smallest_face"])) for now in after if "shortest_edge" in now]
    if not sizes:
        return ""
    edge, face = (min(values) for values in zip(*sizes, strict=True))
    return f"; shortest edge {edge:.2g}" + (f", smallest face {face:.2g}" if face != edge else "") + " of that at rest"


def _above(numbers: Mapping[str, Any]) -> str:
    """Number of faces above each limit that is exceeded."""
    counts = {limit: int(numbers[f"faces_above_{limit}"]) for limit in (65, 75)}
    said = [f"{count} face{'' if count == 1 else 's'} above {limit}°" for limit, count in counts.items() if count]
    return " and ".join(said) or "no face above 65°"

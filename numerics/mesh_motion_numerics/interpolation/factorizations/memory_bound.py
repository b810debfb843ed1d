"""The largest memory of a factorization: a larger one is refused before anything is allocated.

A dense factor of order N takes 4 N² bytes. Sparse factors of points on surfaces have c log₂ N times the entries of
their matrix: 15 times were measured at 18 000 points, 24 times at 100 000. Both bounds keep every array length within
the range of the libraries' 32-bit indices.
"""

import math

from mesh_motion_protocol.errors import ResourceExhausted

#: 4 GiB: a dense factor of order 32 768.
FACTOR_BYTES = 1 << 32
#: Bytes of a stored entry: a value and its column.
_ENTRY_BYTES = 12.0
#: The factor c.
_FILL = 1.5


def dense_bytes(order: int) -> float:
    """Memory of the lower triangle."""
    return 4.0 * order**2


def sparse_bytes(order: int, mean_row: float) -> float:
    """Memory of matrix and factors, with ``mean_row`` nonzero entries per row."""
    matrix = order * mean_row
    return _ENTRY_BYTES * (matrix + min(_FILL * math.log2(max(order, 2)) * matrix, order**2))


def check_dense(order: int) -> None:
    """Raise ResourceExhausted if a dense factor would be too large."""
    _check(
        f"a dense factorization of {order} control points",
        dense_bytes(order),
        "take a basis with compact support, or a reduction of the control points",
    )


def check_sparse(order: int, mean_row: float) -> None:
    """Raise ResourceExhausted if a sparse factor would be too large."""
    _check(
        f"a sparse factorization of {order} control points with {mean_row:.0f} others in reach of each",
        sparse_bytes(order, mean_row),
        "take a smaller support radius",
    )


def _check(what: str, needed: float, way_out: str) -> None:
    if needed > FACTOR_BYTES:
        raise ResourceExhausted(
            f"{what} needs about {needed / 1e9:.1f} GB of memory, more than the {FACTOR_BYTES / 1e9:.1f} GB that one "
            f"may take",
            hint=way_out,
            details={"needed_bytes": int(needed), "limit_bytes": FACTOR_BYTES},
        )

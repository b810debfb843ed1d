"""Values that requests give for nodes: each must be finite, and small enough to be meant."""

from __future__ import annotations

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

#: Limit of a velocity or a weight: numbers that mark a missing value, such as 1e300, are larger, and their products
#: overflow.
_LARGEST = 1e75


def check_values(
    name: str, partition: int, values: Floats, nodes: Integers, limit: float = _LARGEST, limit_is: str = ""
) -> None:
    """Check the values (k, c) of a partition's ``nodes`` (k,).

    Raises InvalidInput: INVALID_ARGUMENT.NONFINITE or .VALUE; the error names the first wrong value and its node.

    Parameters
    ----------
    limit : float
        Largest magnitude.
    limit_is : str
        Words for the limit, after its number.
    """
    if not values.size or (values.max() <= limit and values.min() >= -limit):
        return
    usual, finite = np.abs(values) <= limit, np.isfinite(values)
    row, column = (int(i) for i in np.argwhere(~(usual if finite.all() else finite))[0])
    got = values[row, column]
    where = f"{name} of partition {partition}, row {row} (node {nodes[row]}): component {column} is {got}"
    details = {"partition": partition, "row": row, "node": int(nodes[row]), "value": str(got)}
    if not np.isfinite(got):
        raise InvalidInput(where, code="INVALID_ARGUMENT.NONFINITE", details=details)
    raise InvalidInput(
        f"{where}, expected at most {limit:.3g}{limit_is}",
        code="INVALID_ARGUMENT.VALUE",
        hint=f"check the sender's solver first{', and its unit of length' if limit_is else ''}",
        details=details,
    )

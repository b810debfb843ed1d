"""The deck of a beam clamped at one end: a strip one element thick in plane strain, to start with."""

from __future__ import annotations

from mesh_motion_calculix.errors import DeckError

__all__ = ["flap_deck"]


def flap_deck(
    elements: tuple[int, int] = (2, 20),
    *,
    width: float = 0.1,
    height: float = 1.0,
    thickness: float = 1.0,
    foot: tuple[float, float] = (0.0, 0.0),
    axis: tuple[float, float] = (0.0, 1.0),
    density: float = 3000.0,
    young: float = 4e6,
    poisson: float = 0.3,
) -> str:
    """Deck of a flap; the defaults are those of the perpendicular flap, on y = 0 with its middle at x = 0.

    Elements are bricks with incompatible modes (C3D8I), which bend without locking (two across give the period of the
    first mode within one per cent; C3D8 is 8 % too stiff, C3D8R 14 % too soft). All nodes are held in z, the nodes
    of the foot in every direction.

    Parameters
    ----------
    elements : (int, int)
        Elements across and along the flap.
    width, height, thickness : float
        Extents across and along the flap and in z, length unit.
    foot : (float, float)
        The middle of the clamped end, length unit.
    axis : (float, float)
        Unit vector from the foot to the tip: (1, 0) for a flag that lies along x.
    density, young, poisson : float
        The material, in the units of the rest.

    Returns
    -------
    str
        A model with the node sets NALL, FOOT, TIP and INTERFACE (its wetted sides and top, both planes, with the
        corners at the foot).

    Raises
    ------
    DeckError
        A number of elements or an extent is not positive.
    """
    across, along = elements
    if min(across, along) < 1 or min(width, height, thickness) <= 0.0:
        raise DeckError("a flap needs a positive number of elements and positive extents")

    def number(i: int, j: int, k: int) -> int:
        return 1 + i + (across + 1) * (j + (along + 1) * k)

    def place(i: int, j: int) -> tuple[float, float]:
        across_by, along_by = width * (i / across - 0.5), height * j / along
        return foot[0] + along_by * axis[0] + across_by * axis[1], foot[1] + along_by * axis[1] - across_by * axis[0]

    places = [(i, j, k) for k in range(2) for j in range(along + 1) for i in range(across + 1)]
    nodes = (", ".join(map(str, (number(i, j, k), *place(i, j), thickness * k))) for i, j, k in places)
    return "\n".join([
        "*NODE, NSET=NALL",
        *nodes,
        "*ELEMENT, TYPE=C3D8I, ELSET=EALL",
        *(
            ", ".join(map(str, [
                1 + i + across * j,
                *(number(i + a, j + b, k) for k in range(2) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))),
            ]))
            for j in range(along) for i in range(across)
        ),
        "*NSET, NSET=FOOT", *(f"{number(*p)}," for p in places if p[1] == 0),
        "*NSET, NSET=TIP", *(f"{number(*p)}," for p in places if p[1] == along),
        "*NSET, NSET=INTERFACE", *(f"{number(*p)}," for p in places if p[0] in (0, across) or p[1] == along),
        "*BOUNDARY", "NALL, 3, 3", "FOOT, 1, 2",
        "*MATERIAL, NAME=FLAP",
        "*ELASTIC", f"{young!r}, {poisson!r}",
        "*DENSITY", f"{density!r}",
        "*SOLID SECTION, ELSET=EALL, MATERIAL=FLAP",
        "",
    ])  # fmt: skip

"""Draft a first case file: the mesh's patches, a guessed role for each, and a small motion.

Roles are guesses. The file, or the name of a patch, can show that it is a side of a periodic pair, a symmetry plane
or a far boundary; periodic sides without a partner are fixed, curved symmetry planes slip. A set of all nodes, inner
ones too, is free. Otherwise a patch inside the mesh, which does not reach the sides of the box around all nodes, is a
moving body, and all other patches are fixed; if there is none, the patch that reaches farthest inside moves, but none
that ends at one of two periodic sides or has the name of a far boundary, if there is another. One layer of cells is
treated as a 2D mesh. A body that is joined to a fixed patch bends; others are shifted, in the symmetry planes that
they touch. The motion is tried, and halved until the mesh can follow it.
"""

import math
import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.one_layer import OneLayer
from mesh_motion_numerics.mesh.periodic_pairs import periodic_pairs
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.mesh.smooth_pieces import smooth_pieces
from mesh_motion_numerics.quality.orientation import oriented
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, QualityRefused

from mesh_motion_server.cases.case import Bending, Case, CaseFile, toml_key, toml_text
from mesh_motion_server.cases.clamped import bodies, clamped_bending
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.cases.prediction import Prediction
from mesh_motion_server.files import MeshFile

_Facets = Callable[[], dict[str, Integers]]


_SYMMETRY = ("sym", "axis")
_PERIODIC = re.compile(r"period|cyclic|(?<![a-z])per(?![a-z])", re.IGNORECASE)
_FAR = ("far", "inlet", "outlet", "inflow", "outflow", "outer")
#: Share of the extent: a patch this close to a side of the box reaches the side.
_TOUCH = 1e-3
#: Unit vectors that differ by less than this are the same.
_SAME = 1e-3
_SIDE = "a side of one layer of cells"
#: Size of the first motion that is tried, as a share of the extent of the moving patches, and of the smallest one.
_SHARE = 0.05
_SMALLEST = _SHARE / 64
_STAYS = (
    "# The body touches symmetry planes in all directions, so no translation keeps it on them: it stays.\n"
    "# A table moves its nodes along each plane.\n"
)


def guessed_roles(mesh: MeshFile) -> dict[str, tuple[str, str]]:
    """Guess a role for each patch, with the reason; at least one patch moves.

    Raises InvalidInput for a mesh without patches.
    """
    return _roles(mesh, *_layer(mesh), _facets_of(mesh))


def _facets_of(mesh: MeshFile) -> _Facets:
    """The boundary of a mesh, found at its first use: most drafts do not need it, and a damaged mesh has none."""
    return cache(lambda: boundary_facets(oriented(mesh.points, mesh.cell_table).cells))


def _roles(
    mesh: MeshFile, sides: tuple[str, ...], layer: OneLayer | None, facets: _Facets
) -> dict[str, tuple[str, str]]:
    """Guess roles as :func:`guessed_roles`, from the results of :func:`_layer` and :func:`_facets_of`."""
    if not mesh.patches:
        raise InvalidInput(
            f"{mesh.path}: the mesh has no boundary patches, and a case needs one that moves",
            hint="define groups of boundary facets in the mesh generator (Gmsh: physical groups; SU2: markers; "
            "VTK: arrays patch_<name>)",
        )
    every = [name for name, nodes in mesh.patches.items() if len(np.unique(nodes)) == len(mesh.points)]
    if every and layer is None and _has_inner_nodes(mesh, facets()):
        others = {name: nodes for name, nodes in mesh.patches.items() if name not in every}
        free = dict.fromkeys(every, ("free", "all nodes of the mesh, inner ones too"))
        found = free | _roles(replace(mesh, patches=others), sides, layer, facets)
        return {name: found[name] for name in mesh.patches}
    points = mesh.points if layer is None else layer.project(mesh.points)
    low, high = points.min(axis=0), points.max(axis=0)
    roles = {
        name: ("symmetry", _SIDE)
        if name in sides
        else (mesh.marked[name], "by the file")
        if name in mesh.marked
        else _guess(name, points[nodes], points)
        for name, nodes in mesh.patches.items()
    }
    roles |= _impossible(mesh, {name: role for name, role in roles.items() if name not in sides}, facets)
    if all(role != "moving" for role, _ in roles.values()):
        fixed = [name for name, (role, _) in roles.items() if role == "fixed"] or list(roles)
        inner = {name: _inside(points[mesh.patches[name]], low, high).mean() for name in fixed}
        sides_of_period = [mesh.patches[name] for name, (role, _) in roles.items() if role == "periodic"]

        def fitness(name: str) -> tuple[bool, bool, float]:
            """Whether the patch ends alike at all periodic sides, where nodes and their images must move alike."""
            ends = {len(np.intersect1d(mesh.patches[name], side)) for side in sides_of_period}
            return len(ends) < 2, not _is_far(name), float(inner[name])

        roles[max(fixed, key=fitness)] = ("moving", "no patch is inside the mesh, and one must move")
    return roles


def _has_inner_nodes(mesh: MeshFile, facets: Mapping[str, Integers]) -> bool:
    """Whether a cell has a node that is not on the boundary."""
    nodes, outside = (np.concatenate([each.ravel() for each in of.values()]) for of in (mesh.cells, facets))
    return len(np.setdiff1d(nodes, outside)) > 0


def _impossible(mesh: MeshFile, roles: Mapping[str, tuple[str, str]], facets: _Facets) -> dict[str, tuple[str, str]]:
    """Other roles for periodic patches without a partner, and for curved symmetry planes."""
    named = {kind: [name for name, (role, _) in roles.items() if role == kind] for kind in ("periodic", "symmetry")}
    found: dict[str, tuple[str, str]] = {}
    for name in named["symmetry"]:
        if any(piece.normal is None for piece in smooth_pieces(mesh.points, facets(), mesh.patches[name])):
            found[name] = ("slip", f"a symmetry plane {roles[name][1]}, but curved")
    left = {name: mesh.patches[name] for name in named["periodic"]}
    while left:
        try:
            periodic_pairs(mesh.points, facets(), left)
            break
        except InvalidInput as error:
            name = str(error.details["patch"])
            found[name] = ("fixed", f"periodic {roles[name][1]}, but no other patch is its image")
            del left[name]
    return found


def _planes(mesh: MeshFile, names: Sequence[str], body: Integers, facets: _Facets) -> Floats:
    """(k, d) different normals of the symmetry planes that a body with these nodes touches, and may not leave."""
    pieces = [piece for name in names for piece in smooth_pieces(mesh.points, facets(), mesh.patches[name])]
    touched = [p.normal for p in pieces if p.normal is not None and np.isin(p.nodes, body).any()]
    found: list[Floats] = []
    for normal in touched:
        if all(abs(float(normal @ other)) < 1.0 - _SAME for other in found):
            found.append(normal)
    return np.array(found).reshape(-1, mesh.dimension)


def _direction(axes: Floats, planes: Floats) -> Floats:
    """(d,) the first of the ``axes`` (k, d) that lies in planes with the normals (p, d), or its nearest one in them.

    It is 0 if no direction lies in all the planes.
    """
    _, sizes, across = np.linalg.svd(planes)
    free = across[np.count_nonzero(sizes > _SAME) :]
    along = axes @ free.T @ free
    lengths = np.linalg.norm(along, axis=1)
    best = int(np.argmax(lengths > 0.5 * lengths.max()))
    return np.asarray(along[best] / lengths[best] if lengths[best] > _SAME else np.zeros(len(along[best])))


def _layer(mesh: MeshFile) -> tuple[tuple[str, ...], OneLayer | None]:
    """The layer of cells, and the one or two patches on its two sides."""
    large = [name for name, nodes in mesh.patches.items() if mesh.dimension == 3 and 4 * len(nodes) >= len(mesh.points)]
    whole = tuple(name for name in large if len(np.unique(mesh.patches[name])) == len(mesh.points))[:1]
    cells = oriented(mesh.points, mesh.cell_table).cells if large else mesh.cell_table
    for sides in [*combinations(large, 1), *combinations(large, 2)]:
        patches = {
            name: Patch("symmetry" if name in sides else "moving", nodes) for name, nodes in mesh.patches.items()
        }
        layer = OneLayer.find(mesh.points, cells, patches)
        if layer is not None:
            return sides, layer
    return whole, None


def _guess(name: str, points: Floats, everywhere: Floats) -> tuple[str, str]:
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    if _PERIODIC.search(name):
        return "periodic", "by its name"
    if any(word in name.lower() for word in _SYMMETRY):
        return "symmetry", "by its name"
    if _is_far(name):
        return "fixed", "by its name"
    if len(points) and _inside(points, low, high).all():
        return "moving", "inside the mesh"
    return "fixed", "at the outside"


def _is_far(name: str) -> bool:
    return any(word in name.lower() for word in _FAR)


def _inside(points: Floats, low: Floats, high: Floats) -> Marks:
    """(k,) whether each point is away from the sides of the box."""
    near = _TOUCH * (high - low).max()
    return np.asarray(((points > low + near) & (points < high - near)).all(axis=1))


def tried_draft(mesh: MeshFile, path: Path, zone: str = "") -> tuple[str, str]:
    """The text of a case file at ``path`` with the largest motion that was tried and accepted, and an empty text.

    If none is accepted, or the mesh cannot be moved with these roles, the first draft and the reason.

    Raises
    ------
    InvalidInput
        For a mesh without patches.
    """
    prediction, share, first, refused = None, _SHARE, "", ""
    while share >= _SMALLEST:
        text = draft(mesh, path.parent, zone, share)
        first = first or text
        try:
            case = Case(path, CaseFile.model_validate(tomllib.loads(text)))
            program = MotionProgram.of(case, case.fitting(mesh))
            prediction = replace(prediction or Prediction.of(case, mesh, program), program=program)
            prediction.model.move(mesh.points, prediction.targets(program.count))
        except QualityRefused as error:
            refused = refused or error.message
            share /= 2.0 ** max(1, math.ceil(-math.log2(error.fraction or 0.125)))
        except MeshMotionError as error:
            return first, error.message
        else:
            return text, ""
    return first, refused


def draft(mesh: MeshFile, folder: Path, zone: str = "", share: float = _SHARE) -> str:
    """The text of a case file in ``folder`` that moves the guessed patches by a share of their extent.

    Raises InvalidInput for a mesh without patches.
    """
    sides, layer = _layer(mesh)
    facets = _facets_of(mesh)
    roles = _roles(mesh, sides, layer, facets)
    patches = "\n".join(
        f'{toml_key(name)} = "{role}"  # {len(mesh.patches[name])} nodes; {reason}'
        for name, (role, reason) in roles.items()
    )
    moving = [name for name, (role, _) in roles.items() if role == "moving"]
    nodes = np.unique(np.concatenate([mesh.patches[name] for name in moving]))
    body = mesh.points[nodes]
    centre = (body.min(axis=0) + body.max(axis=0)) / 2
    axes = np.roll(np.eye(mesh.dimension), -1, axis=0) if layer is None else layer.axes[::-1]
    symmetric = [name for name, (role, _) in roles.items() if role == "symmetry" and name not in sides]
    planes = _planes(mesh, symmetric, nodes, facets)
    direction = _direction(axes, planes)
    normal = None if layer is None else np.cross(*layer.axes)
    if normal is None and len(planes) == 1 and mesh.dimension == 3:
        normal = planes[0]
    extent = float(np.ptp(mesh.points, axis=0).max())
    length = share * (float(np.ptp(body, axis=0).max()) or extent)
    axis = np.eye(3)[2] if normal is None else normal
    about = f"centre = {_vector(centre)}" + (f", axis = {_vector(axis)}" if mesh.dimension == 3 else "")
    shift = _vector(length * direction, 11 if len(planes) else 4)
    rigid = f"rigid = {{ translation = {shift}, rotation = 0.0, {about} }}"
    fixed = [name for name, (role, _) in roles.items() if role == "fixed"]
    motions = "\n".join(
        f"[[motion]]\npatch = {toml_text(name)}\n{rigid if bent is None else _bending(bent, extent)}\n"
        for body in bodies(mesh, moving)
        for bent in [clamped_bending(mesh, body, fixed, share, normal)]
        for name in body
    )
    swings = direction
    if not direction.any():
        motions, swings = _STAYS + motions, axes[0]
    zoned = f"\nzone = {toml_text(zone)}" if zone else ""
    return f"""# Roles are guesses: check them. Then `mesh-motion check` and `mesh-motion play` with this file.
# All keys: docs/reference/case_file.md. Lengths are in the mesh's unit, angles in degrees.

[mesh]
file = {toml_text(os.path.relpath(mesh.path, folder))}{zoned}

[patches]  # moving, fixed, slip, symmetry, periodic or free (left out)
{patches}

# The total motion of a patch over all steps; several of one patch add up. Other kinds:
# oscillation = {{ amplitude = {_number(100 * share)}, frequency = 0.05, {about} }}  # degrees, periods a step
# oscillation = {{ amplitude = {_number(length)}, frequency = 0.05, direction = {_vector(swings)} }}
# table = "motion.npz"  # node_ids (n), displacement (steps, n, {mesh.dimension})
{motions}
[steps]
count = 10

[method]  # what is left out is chosen for the mesh
# quality_threshold = 0.2
# refuse_below_threshold = true
"""


def _bending(motion: Bending, extent: float) -> str:
    """The key ``bending``, with the digits that count in a mesh of this extent: clamped nodes must not move."""
    digits = 11 - math.ceil(math.log10(extent))
    given = motion.model_dump(exclude_defaults=True)
    for key in ("clamp", "tip", "axis"):
        if key in given:
            given[key] = [round(value, 11 if key == "axis" else digits) + 0.0 for value in given[key]]  # no -0.0
    text = ", ".join(f"{key} = {'true' if value is True else value}" for key, value in given.items())
    return f"bending = {{ {text} }}"


def _vector(values: Floats, digits: int = 4) -> str:
    return "[" + ", ".join(_number(value, digits) for value in values) + "]"


def _number(value: float, digits: int = 4) -> str:
    """The number with four digits, enough for a draft, or more."""
    return repr(float(f"{value:.{digits}g}") + 0.0)  # no -0.0

"""Checks that the method fits the mesh, when a session is built.

Errors in the keys alone are refused earlier (:mod:`~mesh_motion_numerics.method`). A basis function may be
unusable here because it has no gradient at a control point where one is needed, or because it needs a shape parameter
and none was given. Conditionally definite functions are usable only with the linear polynomial, which the control
points must determine.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.factorizations.memory_bound import check_dense
from mesh_motion_numerics.interpolation.kernels import Basis, basis_named, checked_radius
from mesh_motion_numerics.interpolation.polynomial import LinearBasis
from mesh_motion_numerics.mesh.coincidence import coincident_nodes
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method

#: Largest ratio between a length of the method and the extent of the mesh, either way.
_EXTENTS = 1e12


def check_method(method: Method, points: Floats, roles: BoundaryRoles, *, periodic: bool = False) -> None:
    """Refuse a method that cannot move this mesh.

    Raises InvalidInput on an unusable basis, a missing shape parameter, a length out of range for this mesh, or control
    points that do not determine the polynomial of the basis; with periodic patches, on a basis without compact support
    or a reduction. ``.MESH_DEGENERATE`` on boundary nodes at the same place, if the method needs distinct nodes. Raises
    ResourceExhausted if the matrix of all boundary nodes has to be factorized densely and would take too much memory.

    Parameters
    ----------
    method : Method
        The method as chosen by the user, before missing radii are set.
    points : (n, d) array, mesh length unit
    periodic : bool
        Whether the mesh has periodic patches.
    """
    basis = _checked_basis(method, points.shape[1])
    _check_lengths(method, points)
    if basis.needs_polynomial:
        with _naming("basis", method):
            LinearBasis.around(points[roles.prescribed])
        check_dense(len(roles.prescribed))
    if periodic:
        _check_periodic(method, basis)
    _check_places(method, basis, points, roles, periodic=periodic)


def _checked_basis(method: Method, dimension: int) -> Basis:
    """The basis function, if it has the gradients and the shape parameter that the method needs."""
    # above 1D the imposed gradient is that of cells, and not of the field
    with _naming("basis", method):
        basis = basis_named(method.basis, gradient=method.correction == "imposed-gradient" and dimension == 1)
    if basis.radius_meaning == "shape":
        with _naming("support_radius", method):
            checked_radius(method.support_radius, basis)
    return basis


@contextmanager
def _naming(setting: str, method: Method) -> Iterator[None]:
    """Attribute an invalid input raised inside the block to this setting, and name the setting in the message."""
    try:
        yield
    except InvalidInput as error:
        said = error.message
        message = said if setting in said else f"{setting} = {getattr(method, setting)!r}: {said}"
        raise _unfit(setting, message, hint=error.hint) from error


def _unfit(setting: str, message: str, *, hint: str = "") -> InvalidInput:
    """The error for a setting that does not fit the other settings or the mesh."""
    return InvalidInput(
        message, code="INVALID_ARGUMENT.SETTINGS", hint=hint or "set another value", details={"setting": setting}
    )


def _check_lengths(method: Method, points: Floats) -> None:
    """Refuse lengths out of range for this mesh: r/R overflows or is lost in rounding, for any function."""
    extent = float(np.ptp(bounding_box(points), axis=0).max())
    for name in ("support_radius", "enrichment_radius"):
        length = getattr(method, name)
        if length and not extent / _EXTENTS <= length <= extent * _EXTENTS:
            raise _unfit(
                name,
                f"{name} = {length!r}: expected {1 / _EXTENTS:.0e} to {_EXTENTS:.0e} times the extent of the mesh, "
                f"{extent:.3g}",
                hint="leave it out, or give a length in the unit of the mesh",
            )


def _check_periodic(method: Method, basis: Basis) -> None:
    """Refuse settings that a periodic interpolation does not support."""
    if not basis.compact:
        raise _unfit(
            "basis",
            f"the basis {basis.name!r} has no compact support: infinitely many periodic images would count",
            hint="use one of the Wendland functions, for example basis = 'wendland-c2'",
        )
    if method.reduction != "none":
        raise _unfit(
            "reduction",
            f"reduction = {method.reduction!r} is not offered with periodic patches",
            hint="use reduction = 'none'",
        )


def _check_places(method: Method, basis: Basis, points: Floats, roles: BoundaryRoles, *, periodic: bool) -> None:
    """Refuse control points at the same place, unless they are interpolated as one."""
    if method.reduction != "none":
        reason = f"reduction = {method.reduction!r}"
    elif not basis.compact:
        reason = f"basis = {method.basis!r}"
    elif periodic:
        reason = "a mesh with periodic patches"
    else:
        return
    pairs = coincident_nodes(points, roles.all)
    if not len(pairs):
        return
    a, b = pairs[0].tolist()
    raise InvalidInput(
        f"the boundary nodes {a} and {b} are at the same place, {points[a].tolist()}: {reason} needs distinct ones",
        code="INVALID_ARGUMENT.MESH_DEGENERATE",
        hint="merge them" if periodic else "leave it out, or merge them",
        details={"nodes": [a, b]},
    )

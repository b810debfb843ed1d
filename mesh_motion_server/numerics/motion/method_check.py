"""Does the method fit the mesh? What only both together can answer, refused when a session is built.

A basis function may be unusable for three reasons, all of them in its row of
:data:`.interpolation.kernels.BASES`: its matrix is singular (QB), it has no gradient at a control point
although one will be needed there, or it has a shape parameter and none was given. Conditionally definite functions are
usable beside the linear polynomial only, which the control points must determine.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.correction.correction_problem import check_placement
from mesh_motion_server.numerics.interpolation.factorizations.memory_bound import check_dense
from mesh_motion_server.numerics.interpolation.interpolant import chosen_polynomial
from mesh_motion_server.numerics.interpolation.kernels import Basis, basis_named, checked_radius
from mesh_motion_server.numerics.mesh.coincidence import coincident_nodes
from mesh_motion_server.numerics.mesh.points import bounding_box
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles
from mesh_motion_server.numerics.method import Method

__all__ = ["check_method"]

#: What evaluates ∇S, at control points too where a cell's midpoint or centre comes close to one.
_GRADIENT_PREDICTORS = ("edge-midpoint-gradient", "centre-gradient")


#: What solves the bordered system of a conditionally definite basis.
_DENSE_SOLVERS = ("auto", "dense")
#: A length of the method is at most so many extents of the mesh, and an extent at most so many lengths.
_EXTENTS = 1e12


#: What an interpolation with periodic images offers, by key.
_PERIODIC_CHOICES = {
    "solver": ("auto", "dense", "sparse"),
    "polynomial": ("auto", "none"),
    "reduction": ("none",),
    "volume_reduction": ("none",),
}


def check_method(method: Method, points: NDArray[np.float64], roles: BoundaryRoles, *, periodic: bool = False) -> None:
    """Refuse a method that cannot move this mesh.

    Parameters
    ----------
    method : Method
        As chosen, radii not filled in.
    points : (n, d) array, mesh length unit
    roles : BoundaryRoles
    periodic : bool
        Whether the mesh has periodic patches.

    Raises
    ------
    InvalidInput
        On an unknown or unusable basis, a missing shape parameter, a radius that is both given and to be chosen, a
        polynomial that the basis or the control points do not admit, a reduction beside a polynomial, a placement of
        the enrichment points that the correction has not, a correction that cannot be smooth in time, a boundary
        layer with a predictor that needs gradients, or sub-steps without a correction; with periodic patches on a
        basis without compact support, a polynomial, a reduction, or the solvers "iterative" and "two-scale".
        ``.MESH_DEGENERATE`` on boundary nodes at the same place, where only distinct ones will do.
    ResourceError
        If the matrix of all boundary nodes has to be factorized densely and would take too much memory.
    """
    basis = _checked_basis(method, points.shape[1])
    if method.boundary_layer_thickness is not None:
        _check_layer(method, points.shape[1])
    _check_lengths(method, points)
    _check_solver(method, basis)
    if method.support_radius_choice == "motion":
        _check_choice_from_motion(method, basis)
    _check_reductions(method, basis, points[roles.prescribed])
    with _naming("enrichment_placement", method):
        check_placement(method.correction, method.enrichment_placement, points.shape[1])
    if method.correction_in_time == "smooth":
        _check_smooth(method)
    if method.sub_steps == "always" and method.correction == "none":
        raise _unfit(
            "sub_steps",
            "sub_steps = 'always' corrects every sub-step, got correction 'none'",
            hint="set another correction, or sub_steps = 'auto'",
        )
    if periodic:
        _check_periodic(method, basis)
    _check_places(method, basis, points, roles, periodic=periodic)


def _checked_basis(method: Method, dimension: int) -> Basis:
    """The basis function, if it has what will be asked of it."""
    # above 1D the imposed gradient is one of cells and not of the field
    gradient = method.predictor in _GRADIENT_PREDICTORS or (method.correction == "imposed-gradient" and dimension == 1)
    with _naming("basis", method):
        basis = basis_named(method.basis, gradient=gradient)
    if basis.radius_meaning == "shape":
        with _naming("support_radius", method):
            checked_radius(method.support_radius, basis)
    return basis


def _check_solver(method: Method, basis: Basis) -> None:
    """Refuse a solver that the basis has not."""
    if basis.needs_polynomial and method.solver not in _DENSE_SOLVERS:
        raise _unfit(
            "solver",
            f"solver = {method.solver!r}: the basis {basis.name!r} has only a dense one",
            hint="leave solver out, or take a basis with compact support",
        )


def _check_reductions(method: Method, basis: Basis, control_points: NDArray[np.float64]) -> None:
    """Refuse a reduction that does not go with the rest, and a dense matrix of all control points beyond memory."""
    if method.volume_reduction != "none" and method.predictor in _GRADIENT_PREDICTORS:
        raise _unfit(
            "predictor",
            f"predictor = {method.predictor!r} needs the motion's gradient, which a volume reduction does not give",
            hint="use 'trial-nodes'",
        )
    with _naming("polynomial", method):
        linear = chosen_polynomial(method.polynomial, basis, control_points)
    if method.reduction != "none" and linear is not None:
        raise _unfit(
            "reduction",
            f"reduction = {method.reduction!r} needs a positive definite basis without a polynomial, got basis "
            f"{method.basis!r} with polynomial {method.polynomial!r}",
            hint="basis = 'wendland-c2' and polynomial = 'auto', or reduction = 'none'",
        )
    if method.reduction == "none" and (method.solver == "dense" or basis.needs_polynomial):
        check_dense(len(control_points))


@contextmanager
def _naming(setting: str, method: Method) -> Iterator[None]:
    """What is refused inside is this setting's fault, and says so."""
    try:
        yield
    except InvalidInput as error:
        said = error.message
        message = said if setting in said else f"{setting} = {getattr(method, setting)!r}: {said}"
        raise _unfit(setting, message, hint=error.hint) from error


def _unfit(setting: str, message: str, *, hint: str = "") -> InvalidInput:
    """A setting that does not go with the others or with the mesh."""
    return InvalidInput(
        message, code="INVALID_ARGUMENT.SETTINGS", hint=hint or "set another value", details={"setting": setting}
    )


def _check_lengths(method: Method, points: NDArray[np.float64]) -> None:
    """Refuse lengths that are none of this mesh: r/R overflows or is lost in rounding, for any function."""
    extent = float(np.ptp(bounding_box(points), axis=0).max())
    for name in ("support_radius", "enrichment_radius", "volume_reduction_length", "boundary_layer_thickness"):
        length = getattr(method, name)
        if length is not None and not extent / _EXTENTS <= length <= extent * _EXTENTS:
            raise _unfit(
                name,
                f"{name} = {length!r}: expected {1 / _EXTENTS:.0e} to {_EXTENTS:.0e} times the extent of the mesh, "
                f"{extent:.3g}",
                hint="leave it out, or give a length in the unit of the mesh",
            )


def _check_choice_from_motion(method: Method, basis: Basis) -> None:
    """Refuse a choice of the support radius from the motion where there is none to choose."""
    if method.support_radius is not None:
        raise _unfit(
            "support_radius",
            f"support_radius_choice = 'motion': expected no support_radius, got {method.support_radius!r}",
            hint="leave support_radius out, or support_radius_choice",
        )
    if basis.radius_meaning != "support":
        raise _unfit(
            "support_radius_choice",
            f"support_radius_choice = 'motion': the basis {basis.name!r} has no support radius",
            hint="leave support_radius_choice out, or use basis = 'wendland-c2'",
        )


def _check_layer(method: Method, dimension: int) -> None:
    """Refuse what a boundary layer that moves with its wall cannot be combined with."""
    if dimension == 1:
        raise _unfit(
            "boundary_layer_thickness",
            "boundary_layer_thickness: expected a mesh in 2D or 3D, got one in 1D",
            hint="leave it out",
        )
    if method.predictor in _GRADIENT_PREDICTORS:
        raise _unfit(
            "predictor",
            f"predictor = {method.predictor!r} needs the motion's gradient, which a boundary layer does not give",
            hint="use 'trial-nodes'",
        )


def _check_smooth(method: Method) -> None:
    """Refuse what a correction that is a function of the boundary alone cannot be combined with."""
    if method.correction != "optimised":
        raise _unfit(
            "correction_in_time",
            f"correction_in_time = 'smooth': expected correction 'optimised', got {method.correction!r}",
            hint="set correction = 'optimised', or correction_in_time = 'independent'",
        )
    if method.support_radius_choice == "motion":
        raise _unfit(
            "correction_in_time",
            "correction_in_time = 'smooth': expected support_radius_choice 'mesh', got 'motion', with which nodes jump "
            "where another radius becomes the best",
            hint="leave support_radius_choice out",
        )
    if method.displacement == "relative":
        raise _unfit(
            "correction_in_time",
            "correction_in_time = 'smooth': expected displacement 'absolute' or 'reanchored', got 'relative', which "
            "depends on the way and not on the boundary alone",
            hint="set displacement = 'absolute', or 'reanchored' for large rotations",
        )


def _check_periodic(method: Method, basis: Basis) -> None:
    """Refuse what an interpolation that repeats with the domain has not."""
    if not basis.compact:
        raise _unfit(
            "basis",
            f"the basis {basis.name!r} has no compact support: infinitely many periodic images would count",
            hint="use one of the Wendland functions, for example basis = 'wendland-c2'",
        )
    for key, offered in _PERIODIC_CHOICES.items():
        if getattr(method, key) not in offered:
            raise _unfit(
                key,
                f"{key} = {getattr(method, key)!r} is not offered with periodic patches",
                hint=f"use {key} = {' or '.join(map(repr, offered))}",
            )


def _check_places(
    method: Method, basis: Basis, points: NDArray[np.float64], roles: BoundaryRoles, *, periodic: bool
) -> None:
    """Refuse control points at the same place, but where they are interpolated as one."""
    if method.reduction != "none":
        reason = f"reduction = {method.reduction!r}"
    elif method.solver not in ("auto", "two-scale"):
        reason = f"solver = {method.solver!r}"
    elif method.solver == "auto" and not basis.compact:
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

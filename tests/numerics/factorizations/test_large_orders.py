"""Boundary matrices of order 18 000 and 100 000: exact at the boundary, or refused with the memory they would need."""

import os

import numpy as np
import pytest
from mesh_motion_numerics.arrays import bytes_of
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.assembly import mean_row_entries
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations.memory_bound import (
    FACTOR_BYTES,
    check_dense,
    check_sparse,
    dense_bytes,
    sparse_bytes,
)
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.method_check import check_method
from mesh_motion_protocol.errors import ResourceExhausted
from numpy.typing import NDArray
from two_scale_boundaries import boundary, sphere, walls

Floats = NDArray[np.float64]

ORDERS = (18_000, 100_000)
LARGE = 2.5
"""A radius with which every matrix is full."""


def cloud(order: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Points of a sphere in a box, a third of them on the walls."""
    box = walls(int((order / 18.0) ** 0.5) + 1)
    return boundary(sphere(order - len(box), 0.25), box)


def radius_of(order: int, neighbours: int) -> float:
    return float(np.sqrt(neighbours * 4.0 * 0.25**2 / (2.0 * order / 3.0)))


def turned(points: Floats, moving: NDArray[np.bool_]) -> Floats:
    """Displacement that turns and bends the sphere and keeps the box in place."""
    x = points - 0.5
    return np.where(moving[:, None], 0.05 * np.stack([-x[:, 1], x[:, 0], x[:, 0] ** 2], axis=1), 0.0)


def boundary_error(points: Floats, values: Floats, found) -> float:
    """Largest error at a control point, as a share of the largest displacement."""
    return float(np.abs(evaluation.displacement(found, points) - values).max() / np.abs(values).max())


@pytest.mark.parametrize(
    ("order", "solver", "neighbours"),
    [
        (18_000, "sparse", 20),
        (18_000, "iterative", 20),
        (18_000, "auto", 20),
        pytest.param(100_000, "sparse", 8, marks=pytest.mark.nightly),
        (100_000, "iterative", 20),
        pytest.param(100_000, "auto", 60, marks=pytest.mark.nightly),
    ],
)
def test_a_short_radius_is_exact_at_the_boundary(order: int, solver: str, neighbours: int) -> None:
    points, moving = cloud(order)
    values = turned(points, moving)
    prepared = factorize(points, support_radius=radius_of(order, neighbours), solver=solver)
    assert prepared.solver in ({"sparse", "iterative"} if solver == "auto" else {solver})
    assert boundary_error(points, values, prepared.solve(values)) <= 1e-10
    assert bytes_of(prepared) <= FACTOR_BYTES


@pytest.mark.parametrize("order", ORDERS)
def test_two_scales_take_the_largest_radius(order: int) -> None:
    points, moving = cloud(order)
    values = turned(points, moving)
    plan = TwoScalePlan.build(points, moving, basis="wendland-c2", support_radius=LARGE)
    prepared = plan.factorize(points, points.min(axis=0), points.max(axis=0))
    assert boundary_error(points, values, prepared.solve(values)) <= 1e-10
    assert bytes_of(prepared) <= 1200 * order  # with the plan's preconditioners


LARGE_TESTS = pytest.mark.skipif("MESH_MOTION_LARGE_TESTS" not in os.environ, reason="minutes, 1.4 GB")


@pytest.mark.nightly
@pytest.mark.parametrize("solver", [pytest.param("dense", marks=LARGE_TESTS), "auto"])
def test_a_full_matrix_of_order_18_000(solver: str) -> None:
    points, moving = cloud(18_000)
    values = turned(points, moving)
    prepared = factorize(points, support_radius=LARGE, solver=solver)
    assert prepared.solver == {"dense": "dense", "auto": "iterative"}[solver]
    assert boundary_error(points, values, prepared.solve(values)) <= 1e-10


@pytest.mark.parametrize(
    ("order", "solver", "basis", "gigabytes"),
    [
        (18_000, "sparse", "wendland-c2", "7.8"),
        (100_000, "dense", "wendland-c2", "40.0"),
        (100_000, "sparse", "wendland-c2", "240.0"),
        (100_000, "auto", "tps", "40.0"),
    ],
)
def test_a_system_too_large_for_the_memory_is_refused_before_it_is_tried(
    order: int, solver: str, basis: str, gigabytes: str
) -> None:
    points, _ = cloud(order)
    with pytest.raises(ResourceExhausted, match=rf"of {order} control points .*needs about {gigabytes} GB") as refused:
        factorize(points, basis=basis, support_radius=LARGE, solver=solver)
    assert "smaller support radius" in refused.value.hint or "reduction" in refused.value.hint
    assert refused.value.details["limit_bytes"] == FACTOR_BYTES


def test_a_session_is_refused_when_it_is_opened() -> None:
    points, moving = cloud(100_000)
    none = np.empty(0, dtype=np.int64)
    roles = BoundaryRoles(np.flatnonzero(moving), np.flatnonzero(~moving), none, none)
    with pytest.raises(ResourceExhausted, match=r"needs about 40\.0 GB"):
        check_method(Method(basis="tps"), points, roles)
    check_method(Method(), points, roles)


def test_the_bounds() -> None:
    check_dense(32_768)
    with pytest.raises(ResourceExhausted, match="32769 control points"):
        check_dense(32_769)
    assert dense_bytes(32_768) == FACTOR_BYTES
    check_sparse(100_000, 60.0)
    with pytest.raises(ResourceExhausted, match="300 others in reach"):
        check_sparse(100_000, 300.0)


@pytest.mark.parametrize("neighbours", [10, 60])
def test_sparse_factors_take_no_more_than_is_said(neighbours: int) -> None:
    points, _ = cloud(5000)
    radius = radius_of(5000, neighbours)
    row = mean_row_entries(CentreLayout.build(points, BASES["wendland-c2"], radius), radius)
    assert bytes_of(factorize(points, support_radius=radius, solver="sparse")) < sparse_bytes(5000, row)

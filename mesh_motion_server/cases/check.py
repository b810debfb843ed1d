"""Check a case or a mesh before it is played: the motion is only predicted, nothing is stored.

Errors are the same as when a session is opened. Unusual but allowed input gives a warning.
"""

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.support_radius import with_reach
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.one_layer import OneLayer
from mesh_motion_numerics.mesh.periodic_nodes import PeriodicNodes
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.acceptance import other_unit
from mesh_motion_numerics.motion.method_check import check_method
from mesh_motion_numerics.motion.one_layer_motion import AS_A_PLANE
from mesh_motion_numerics.quality.mesh_check import checked_mesh
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_numerics.quality.orientation import oriented
from mesh_motion_numerics.reduction.reduced_motion import boundary_spacing
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, QualityRefused

from mesh_motion_server.cases.case import Case, read_case
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.cases.prediction import Prediction, named
from mesh_motion_server.files import MeshFile, read_mesh
from mesh_motion_server.files.reader import is_mesh

#: Share of the mesh's extent: a shorter motion is probably in another unit.
_NEAREST = 1e-5
_KINDS = ("moving", "fixed", "sliding", "periodic")


@dataclass(frozen=True)
class CheckReport:
    """The result of a check."""

    path: Path
    mesh: MeshFile
    roles: dict[str, str]  # role of each patch; empty for a mesh without a case
    counts: dict[str, int]  # numbers of moving, fixed and sliding nodes, and of nodes that are only periodic
    pairs: list[str]  # a text for each pair of periodic patches
    quality: dict[str, float]  # minimum and mean skew of the mesh in the file
    support_radius: float | None  # the support radius of the case, if it sets one
    suggested: Method  # with the basis and the radii that are chosen if the case sets no support radius
    warnings: list[str]
    steps: int = 0  # number of steps of the case's motion that were predicted and are accepted
    refused: str = ""  # which step will be refused, why and where; empty if none is known


def check(path: Path, zone: str = "", *, seconds: float = 0.0) -> CheckReport:
    """Check a case file, or a mesh file alone; ``zone`` selects one of several zones by its name or number.

    Raises InvalidInput if the case cannot be played; names the first problem.

    Parameters
    ----------
    seconds : float
        About how long to predict the case's motion, step by step.
    """
    if is_mesh(path) or path.suffix.lower() not in (".toml", ""):
        return _report(path, read_mesh(path, zone), None)
    case = read_case(path)
    mesh = case.read_mesh()
    program = MotionProgram.of(case, mesh)
    warnings = [f"patch {name!r} is moving, but no motion is given for it: it stays in place" for name in program.still]
    report = _report(path, mesh, case, [*warnings, *_odd_motion(mesh, case, program)])
    return _predicted(report, Prediction.of(case, mesh, program), seconds) if seconds > 0.0 else report


def _predicted(report: CheckReport, prediction: Prediction, seconds: float) -> CheckReport:
    """The report with the predicted motion, as many steps as the seconds allow."""
    begin, committed, refused = time.perf_counter(), prediction.reference, ""
    count, threshold = prediction.program.count, prediction.model.method.quality_threshold
    minima: list[float] = []
    try:
        for motion in prediction.steps():
            minima.append(motion.corrected.metric.min)
            committed = motion.points
            if time.perf_counter() - begin > seconds:
                break
    except QualityRefused as error:
        refused = f"step {len(minima) + 1} of {count} will be refused: {error.message}"
        with suppress(MeshMotionError):  # no mesh exists at all; the error gives the reason
            refused += f"; {named(prediction.worst(prediction.trial(committed, len(minima) + 1))[0])}"
    warnings = list(report.warnings)
    low = [step for step, minimum in enumerate(minima, start=1) if minimum < threshold]
    if low:
        warnings.append(
            f"{len(low)} of {len(minima)} steps stay below the threshold {threshold:g}, the first is step {low[0]}; "
            f"lowest minimum {min(minima):.3g}"
        )
    if not refused and len(minima) < count:
        warnings.append(
            f"steps {len(minima) + 1} to {count} were not tried in {seconds:g} s: --seconds allows more time"
        )
    return replace(report, warnings=warnings, steps=len(minima), refused=refused)


def _odd_motion(mesh: MeshFile, case: Case, program: MotionProgram) -> list[str]:
    """Warnings for a motion that is probably a mistake: in a unit that is not the mesh's, or out of its domain."""
    displacements = [program.displacement(step) for step in range(1, program.count + 1)]
    if doubt := other_unit(mesh.points, np.concatenate(displacements), _NEAREST):
        return [doubt]
    split = BoundaryRoles.from_patches({n: Patch(role, mesh.patches[n]) for n, role in case.roles.items()})
    box = mesh.points[np.setdiff1d(split.all, program.nodes)]
    at_rest = mesh.points[program.nodes]
    if len(box) and (at_rest > box.min(axis=0)).all() and (at_rest < box.max(axis=0)).all():
        for step, rows in enumerate(displacements, start=1):
            out = np.flatnonzero(((at_rest + rows < box.min(axis=0)) | (at_rest + rows > box.max(axis=0))).any(axis=1))
            if len(out):
                place = ", ".join(f"{x:.4g}" for x in (at_rest + rows)[out[0]])
                return [f"the body leaves the domain in step {step}: node {program.nodes[out[0]]} comes to ({place})"]
    return []


def _report(path: Path, mesh: MeshFile, case: Case | None, warnings: list[str] | None = None) -> CheckReport:
    """Check the mesh with the case's roles, or with every patch moving."""
    warnings = [*mesh.notes, *(warnings or [])]
    roles = dict(case.roles) if case is not None else {}
    patches = {name: Patch(roles.get(name, "moving"), nodes) for name, nodes in mesh.patches.items()}
    if not patches:
        warnings.append("the mesh has no patches: name its boundaries (physical groups, markers, patch_<name> arrays)")
    warnings += [
        f"patch {name!r} is one side of a period in the mesh file: give it the role periodic"
        for name, role in mesh.marked.items()
        if role == "periodic" != roles.get(name)
    ]
    try:
        if not patches:
            boundary = boundary_nodes(oriented(mesh.points, mesh.cell_table).cells)
            patches = {"boundary": Patch("moving", boundary)}
        checked = checked_mesh(mesh.points, mesh.cell_table, patches)
        cells, sizes = checked.cells, checked.reference_sizes
        warnings += checked.warnings
        if OneLayer.find(mesh.points, cells, patches) is not None:
            warnings.append(AS_A_PLANE)
        split = BoundaryRoles.from_patches(patches)
        periodic = PeriodicNodes.build(mesh.points, boundary_facets(cells), patches, split)
    except InvalidInput as error:
        raise InvalidInput(f"{mesh.path}: {error.message}", code=error.code, hint=error.hint) from None
    without_loose = split.without(mesh.points, checked.loose)
    method = Method() if case is None else case.content.method.to_method()
    if case is not None:
        check_method(method, *without_loose, periodic=periodic is not None)
    quality = cell_quality(mesh.points, cells, sizes)
    radius = None if case is None else case.content.method.support_radius
    unnamed = replace(method, support_radius=None)
    suggested = with_reach(unnamed, *without_loose, periodic=periodic)[0]
    control = mesh.points[split.all]
    return CheckReport(
        path=path,
        mesh=mesh,
        roles={name: str(role) for name, role in roles.items()},
        counts={name: len(getattr(split, name)) for name in _KINDS} if roles else {},
        pairs=[] if periodic is None else [pair.describe() for pair in periodic.pairs],
        quality={"minimum skew": float(quality.skew.min()), "mean skew": float(quality.skew.mean())},
        support_radius=radius,
        suggested=suggested,
        warnings=warnings + _radius_warnings(radius, control),
    )


def _radius_warnings(radius: float | None, control: Floats) -> list[str]:
    """Warn of a support radius that connects no control points: the interpolation then gives only spikes."""
    if radius is None or len(control) < 2:
        return []
    spacing = boundary_spacing(control)
    if radius >= 3.0 * spacing:
        return []
    return [f"support_radius = {radius:g} is little more than the spacing of the boundary nodes ({spacing:.3g})"]

"""The position of every moving node after each step of a case.

A rigid motion with the total angle θ about c and the total translation t displaces a node at X after step s of S by

    u_s(X) = s/S t + (R(s/S θ) - I) (X - c),

so the angle is interpolated, not the matrix, and a body stays rigid in every step. An oscillation of frequency f and
phase φ uses sin(2π f s + φ) - sin φ instead of s/S; it is 0 at the reference mesh. A bending
turns each section by its share of the angle, so that the body's middle line becomes an arc of the same length; a line
that is clamped at both ends is lifted by L/π tan(s/S θ) sin²(π ξ/L) at the distance ξ from the clamp. Several motions
of one patch add their displacements, each computed from the reference coordinates. If two moving patches share a node,
both must give it the same displacement, as :mod:`mesh_motion_protocol.shared_nodes` says. Otherwise the mesh would
tear: the case is refused and the error names the node.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.shared_nodes import Torn, united

from mesh_motion_server.cases.case import Bending, Case, Oscillation, RigidMotion
from mesh_motion_server.files import MeshFile
from mesh_motion_server.files.npz import read_archive


class PatchProgram(Protocol):
    """The motion of one patch."""

    def displacement(self, step: int) -> Floats:
        """(p, d) total displacement of the patch's nodes after a step."""


@dataclass(frozen=True, eq=False)
class RigidProgram:
    """A rigid motion of the nodes at ``points`` (p, d); ``fraction`` returns the share that is done after a step."""

    points: Floats
    motion: RigidMotion
    fraction: Callable[[int], float]

    def displacement(self, step: int) -> Floats:
        dimension = self.points.shape[1]
        fraction = self.fraction(step)
        total = np.zeros_like(self.points)
        if self.motion.translation is not None:
            total += fraction * np.array(self.motion.translation)
        if self.motion.rotation:
            rotation = _rotation(np.deg2rad(fraction * self.motion.rotation), self.motion.axis, dimension)
            total += (self.points - np.array(self.motion.centre)) @ (rotation - np.eye(dimension)).T
        return total


@dataclass(frozen=True, eq=False)
class BendingProgram:
    """A bending of the nodes at ``points`` (p, d); ``fraction`` returns the share of its angle after a step.

    Sections stay plane and normal to the middle line. Nodes behind the clamp do not move; nodes beyond the tip continue
    the middle line straight.
    """

    points: Floats
    motion: Bending
    fraction: Callable[[int], float]

    def displacement(self, step: int) -> Floats:
        angle = np.deg2rad(self.motion.rotation) * self.fraction(step)
        clamp = np.array(self.motion.clamp)
        along, across, length = _bending_frame(self.motion)
        ahead, aside = (self.points - clamp) @ along, (self.points - clamp) @ across
        place = np.clip(ahead, 0.0, length)
        line = _arch(place, angle, length) if self.motion.both_ends else _arc(place, angle, length)
        (forward, lift, slope), past = line, ahead - place
        moved = (
            np.outer(forward + past * np.cos(slope) - aside * np.sin(slope) - ahead, along)
            + np.outer(lift + past * np.sin(slope) + aside * (np.cos(slope) - 1), across)
        )  # fmt: skip
        moved[(ahead <= 0) | (self.motion.both_ends & (ahead >= length))] = 0.0
        return moved


@dataclass(frozen=True, eq=False)
class TableProgram:
    """Tabulated total displacements (S, p, d), one for each step."""

    table: Floats

    def displacement(self, step: int) -> Floats:
        return self.table[step - 1] if step else np.zeros_like(self.table[0])


@dataclass(frozen=True, eq=False)
class _PatchMotion:
    """All motions of one moving patch: its name, the indices of its nodes in the program's nodes (p,), its programs."""

    name: str
    places: Integers
    programs: tuple[PatchProgram, ...]

    def displacement(self, step: int, dimension: int) -> Floats:
        """(p, d) sum over the programs; zero if there are none."""
        zero = np.zeros((len(self.places), dimension))
        return sum((program.displacement(step) for program in self.programs), start=zero)


@dataclass(frozen=True, eq=False)
class MotionProgram:
    """The motion of all moving nodes of a case."""

    nodes: Integers  # (k,). The nodes of all moving patches, ascending, each once
    dimension: int
    count: int  # number of steps
    patches: tuple[_PatchMotion, ...]  # one entry for each moving patch, in the order of the case file
    extent: float  # longest side of the mesh's bounding box, mesh length unit

    @classmethod
    def of(cls, case: Case, mesh: MeshFile) -> MotionProgram:
        """Prepare the program of a case on its mesh.

        Raises InvalidInput if a table does not fit its patch or the number of steps, or two patches disagree about a
        node.
        """
        moving = [name for name, role in case.roles.items() if role == "moving"]
        nodes = np.unique(np.concatenate([mesh.patches[name] for name in moving]))
        patches = tuple(
            _PatchMotion(name, np.searchsorted(nodes, mesh.patches[name]), _programs(case, mesh, name))
            for name in moving
        )
        extent = float(np.ptp(mesh.points, axis=0).max())
        program = cls(nodes, mesh.dimension, case.content.steps.count, patches, extent)
        _check_agreement(program, case.path)
        return program

    @property
    def still(self) -> tuple[str, ...]:
        """Moving patches for which the case has no motion: they do not move."""
        return tuple(patch.name for patch in self.patches if not patch.programs)

    def displacement(self, step: int) -> Floats:
        """(k, d) total displacement, since the reference mesh, of :attr:`nodes` after step 0 … count."""
        rows = [patch.displacement(step, self.dimension) for patch in self.patches]
        return united(rows, [patch.places for patch in self.patches], len(self.nodes), self.extent)


def _programs(case: Case, mesh: MeshFile, patch: str) -> tuple[PatchProgram, ...]:
    """The motions of one patch, in the order of the case file."""
    nodes, count = mesh.patches[patch], case.content.steps.count
    programs: list[PatchProgram] = []
    for motion in case.content.motion:
        if motion.patch != patch:
            continue
        if motion.rigid is not None:
            programs.append(RigidProgram(mesh.points[nodes], motion.rigid, lambda step: step / count))
        elif motion.oscillation is not None:
            programs.append(RigidProgram(mesh.points[nodes], motion.oscillation.rigid, _swing(motion.oscillation)))
        elif motion.bending is not None:
            programs.append(BendingProgram(mesh.points[nodes], motion.bending, lambda step: step / count))
        elif motion.table is not None:
            programs.append(_read_table(case.path.parent / motion.table, patch, nodes, (count, mesh.dimension)))
    return tuple(programs)


def _bending_frame(motion: Bending) -> tuple[Floats, Floats, float]:
    """(d,) unit vectors along the body and towards the side to which it bends, and the body's length."""
    along = np.array(motion.tip) - np.array(motion.clamp)
    length = float(np.linalg.norm(along))
    axis = np.array(motion.axis or (0.0, 0.0, 1.0))
    across = np.cross(axis, np.pad(along, (0, 3 - len(along))))[: len(along)]
    return along / length, across / np.linalg.norm(across), length


def _arc(place: Floats, angle: float, length: float) -> tuple[Floats, Floats, Floats]:
    """(p,) distance forward, distance aside and slope of a line of constant curvature, at arc lengths (p,)."""
    slope = angle * place / length
    half = np.sinc(slope / (2 * np.pi))  # sin(slope/2) / (slope/2)
    return place * half * np.cos(slope / 2), place * half * np.sin(slope / 2), slope


def _arch(place: Floats, angle: float, length: float) -> tuple[Floats, Floats, Floats]:
    """The same for a line whose ends do not move, with its largest slope ``angle`` at a quarter of its length."""
    steepest = np.tan(angle)
    lift = steepest * length / np.pi * np.sin(np.pi * place / length) ** 2
    return place, lift, np.arctan(steepest * np.sin(2 * np.pi * place / length))


def _swing(oscillation: Oscillation) -> Callable[[int], float]:
    """The factor of the amplitude as a function of the step."""
    phase = np.deg2rad(oscillation.phase)
    turn = 2 * np.pi * oscillation.frequency
    return lambda step: float(np.sin(turn * step + phase) - np.sin(phase))


def _read_table(path: Path, patch: str, nodes: Integers, expected: tuple[int, int]) -> TableProgram:
    """Read the table of a patch: its first ``count`` steps, with the rows in the order of ``nodes``."""
    if not path.is_file():
        raise InvalidInput(f"{path}: no such motion table", hint="paths in a case file are relative to the case file")
    arrays = read_archive(path)
    if set(arrays) != {"node_ids", "displacement"}:
        raise InvalidInput(f"{path}: expected 'node_ids' and 'displacement', got {', '.join(map(repr, arrays))}")
    node_ids, displacement = arrays["node_ids"], arrays["displacement"]
    count, dimension = expected
    if node_ids.ndim != 1 or node_ids.dtype.kind not in "iu":
        raise InvalidInput(f"{path}: node_ids: expected integers (n,), got {node_ids.dtype} {node_ids.shape}")
    wanted = (f"at least {count}", len(node_ids), dimension)
    fits = displacement.ndim == 3 and displacement.shape[1:] == wanted[1:] and len(displacement) >= count
    if not fits or displacement.dtype.kind not in "fiu":
        raise InvalidInput(
            f"{path}: displacement: expected real numbers (S, n, d) = ({', '.join(map(str, wanted))}), "
            f"got {displacement.dtype} {displacement.shape}"
        )
    table = displacement[:count].astype(np.float64)
    if not np.isfinite(table).all():
        step, row, _ = (int(i) for i in np.argwhere(~np.isfinite(table))[0])
        raise InvalidInput(f"{path}: the displacement of node {int(node_ids[row])} in step {step + 1} is not finite")
    order = np.argsort(node_ids, kind="stable")
    _check_nodes(path, patch, node_ids[order].astype(np.int64), nodes)
    return TableProgram(np.ascontiguousarray(table[:, order]))


def _check_nodes(path: Path, patch: str, node_ids: Integers, nodes: Integers) -> None:
    """Check that a table names each node of its patch exactly once (both ascending)."""
    if np.array_equal(node_ids, nodes):
        return
    if len(repeated := node_ids[1:][np.diff(node_ids) == 0]):
        raise InvalidInput(f"{path}: node {int(repeated[0])} appears twice in node_ids")
    if len(missing := np.setdiff1d(nodes, node_ids)):
        raise InvalidInput(f"{path}: node {int(missing[0])} of patch {patch!r} is not in node_ids")
    foreign = int(np.setdiff1d(node_ids, nodes)[0])
    raise InvalidInput(f"{path}: node {foreign} in node_ids does not belong to patch {patch!r}")


def _check_agreement(program: MotionProgram, path: Path) -> None:
    """Refuse two patches that give a shared node different displacements."""
    if sum(len(patch.places) for patch in program.patches) == len(program.nodes):
        return
    for step in range(1, program.count + 1):
        try:
            program.displacement(step)
        except Torn as torn:
            one, other = (repr(program.patches[part].name) for part in torn.parts)
            raise InvalidInput(
                f"{path}: node {int(program.nodes[torn.place])} is on the moving patches {one} and {other}, which "
                f"move it differently in step {step}",
                hint="a mesh cannot tear: give both patches the same motion there",
            ) from None


def _rotation(angle: float, axis: Sequence[float] | None, dimension: int) -> Floats:
    """(d, d) rotation matrix; in 2D about +z (or -z for such an axis), in 3D Rodrigues' formula."""
    c, s = float(np.cos(angle)), float(np.sin(angle))
    if dimension == 2:
        s = -s if axis is not None and axis[2] < 0 else s
        return np.array([[c, -s], [s, c]])
    k = np.array(axis, dtype=np.float64) / np.linalg.norm(np.array(axis, dtype=np.float64))
    cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    return c * np.eye(3) + s * cross + (1.0 - c) * np.outer(k, k)

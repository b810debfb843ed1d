"""The interface to the numerics: a model that moves the mesh and judges it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Protocol

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.numbering import UploadView, upload_view

if TYPE_CHECKING:
    from mesh_motion_numerics.interpolation.factor_source import FactorSource
    from mesh_motion_numerics.motion.motion_found import BoundaryDisplacement, Motion
    from mesh_motion_numerics.quality.headroom import Headroom
    from mesh_motion_numerics.quality.quality_summary import Judgement


class Slope(Protocol):
    """The part of :class:`mesh_motion_numerics.motion.motion_slope.MotionSlope` that a session uses."""

    def tangent(self, velocity: Floats) -> Floats:
        """(n, d) velocities of all nodes, for velocities (k, d) of the moving nodes in their order."""
        ...

    def cotangent(self, weights: Floats) -> Floats:
        """(k, d) the derivative of Σ w · y by the moving nodes' positions, for (n, d) weights w of all nodes."""
        ...


class Model(Protocol):
    """The part of :class:`mesh_motion_numerics.motion.motion.MotionModel` that a session uses."""

    @property
    def method(self) -> Method:
        """The method with both radii set."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the mesh check."""
        ...

    def summary(self, points: Floats) -> Judgement:
        """Quality of the mesh with its nodes at ``points`` (n, d)."""
        ...

    def headroom(self, before: Floats, points: Floats, worst: Integers, *, step: bool = True) -> Headroom:
        """The number of further steps like that from ``before`` (n, d) which the mesh, with its ``worst`` (w,) cells,
        admits at ``points`` (n, d); ``step``: this is the run's last step.
        """
        ...

    def why_no_slope(self) -> InvalidInput | None:
        """The reason why the motion has no derivative; None if it has one."""
        ...

    def slope(self, points: Floats, factors: FactorSource) -> Slope:
        """The derivative of the motion that has led to ``points`` (n, d)."""
        ...

    def without_distributions(self) -> Model:
        """The same model, which may judge only by minimum, inverted and worst cells; all exact."""
        ...

    def move(
        self,
        committed: Floats,
        targets: Floats,
        factors: FactorSource,
        *,
        boundary_displacement: BoundaryDisplacement | None = None,
    ) -> Motion:
        """Motion that takes the moving nodes from the committed positions (n, d) to ``targets`` (k, d).

        The ``targets`` are the end of the ``boundary_displacement``; a refusal names the accepted fraction of it. The
        motion's ``corrected`` is equal to :meth:`summary` of its ``points``.
        """
        ...


ModelBuilder = Callable[[Floats, CellTable, Mapping[str, Patch], Method], Model]


def build_motion_model(points: Floats, cells: CellTable, patches: Mapping[str, Patch], method: Method) -> Model:
    """The numerics' model of a mesh."""
    # imported here: the compiled kernels take a second to load, and a process that only lists sessions does not need
    # them
    from mesh_motion_numerics.motion.one_layer_motion import motion_model  # noqa: PLC0415

    return motion_model(points, cells, patches, method)


def model_of(build: ModelBuilder | None, mesh: MergedMesh | UploadView, method: Method) -> Model:
    """The model of a mesh by ``build``; None: the model of its boundary, whose volume stays with the client."""
    if build is not None:
        return build(mesh.points, mesh.cells, mesh.patches, method)
    # imported here for the same reason
    from mesh_motion_numerics.motion.boundary_motion import BoundaryMotion  # noqa: PLC0415

    return BoundaryMotion.build(mesh.points, mesh.facets, mesh.near, mesh.patches, method)


def checked_model(build: ModelBuilder | None, mesh: MergedMesh, method: Method) -> Model:
    """The model of a mesh, made by :func:`model_of`.

    Raises InvalidInput if the mesh is unusable. The mesh is checked a second time, so that the error uses the numbering
    of the upload.
    """
    try:
        return model_of(build, mesh, method)
    except InvalidInput:
        view = upload_view(mesh)
        try:
            model_of(build, view, method)
        except InvalidInput as error:
            raise _with_place(error, view) from error
        raise


def checked_warnings(mesh: MergedMesh, model: Model) -> list[str]:
    """The warnings of the mesh check, in the numbering of the upload."""
    if not model.warnings:
        return []
    # imported here for the same reason
    from mesh_motion_numerics.quality.mesh_check import checked_mesh  # noqa: PLC0415

    view = upload_view(mesh)
    checked = checked_mesh(view.points, view.cells, view.patches).warnings
    return [*checked, *model.warnings[len(checked) :]]


def _with_place(error: InvalidInput, view: UploadView) -> InvalidInput:
    """The error; with several partitions its cell or node is also named by partition."""
    if len(view.mesh.node_maps) == 1:
        return error
    cell, node = error.details.get("cell"), error.details.get("node")
    place: dict[str, object] = {}
    if isinstance(cell, int) and 0 <= cell < len(view.cells):
        place = view.name_cell(cell)
    elif isinstance(node, int) and 0 <= node < len(view.points):
        place = view.name_node(node)
    hint = "; ".join(filter(None, (error.hint, "nodes count by global id, cells through the partitions")))
    return InvalidInput(error.message, code=error.code, hint=hint, details=error.details | place)

"""Messages of a session's data endpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from mesh_motion_protocol.declarations import Choice
from mesh_motion_protocol.field_types import (
    CornerNodes,
    Count,
    Digest,
    FieldBoxes,
    FieldCentres,
    FieldCoefficients,
    FieldColumns,
    FloatEnrichment,
    FloatMoving,
    FloatMovingIfGiven,
    FloatNodes,
    FloatNodesIfAsked,
    Frame,
    FreedIds,
    FreedVectors,
    HeadroomAlong,
    JudgedBins,
    JudgedCells,
    JudgedValues,
    KnownMovingIndices,
    KnownPatchIndices,
    MovingIndices,
    MovingVectors,
    Name,
    NodeVectors,
    Outcome,
    Partition,
    Reach,
    RegionCorners,
    RegionDisplacement,
    RegionIds,
    RegionNodes,
    RegionPlaces,
    RegionTold,
    RegionVectors,
    Report,
    Role,
    SessionId,
    SweptVolumes,
    Time,
    TimeScheme,
    Token,
    UploadRows,
    WallFacets,
    Which,
)
from mesh_motion_protocol.message import Message

__all__ = [
    "Build",
    "Built",
    "Close",
    "Closed",
    "Commit",
    "Committed",
    "Correct",
    "Corrected",
    "Cotangent",
    "CotangentFound",
    "Fetch",
    "Fetched",
    "Join",
    "Joined",
    "Judge",
    "Judged",
    "Move",
    "Moved",
    "Rollback",
    "RolledBack",
    "SessionMessage",
    "Status",
    "StatusReport",
    "Tangent",
    "TangentFound",
    "Upload",
    "Uploaded",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionMessage(Message):
    """Base of the requests to a session's data endpoint."""

    session: SessionId  # as in OPENED
    epoch: Count  # of OPENED or RESUMED
    partition: Partition = 0  # 0 … partitions - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Join(SessionMessage):
    """First message on a data connection; proves the right to the session."""

    type: ClassVar[str] = "JOIN"
    token: Token  # as in OPENED


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined(Message):
    """Answer to JOIN: where the session stands."""

    type: ClassVar[str] = "JOINED"
    state: str  # a state of the session table
    step: int  # last committed step
    iteration: int  # iterations of the open trial, 0 = none
    dimension: int = 0  # as in OPEN; 0 = the server does not say
    partitions: int = 0  # as in OPEN; 0 = the server does not say
    nodes: int = 0  # nodes of this partition once BUILT
    evaluation: str = "server"  # as in OPEN
    time: Time = None  # of the last committed step, if it is known: section 25
    extent: float = 0.0  # longest side of the bounding box of the whole mesh, once BUILT; 0 = the server does not say
    moving_patches: list[list[Any]] = field(default_factory=list)  # [name, number of nodes] of each, once BUILT
    moving_nodes: KnownMovingIndices = None  # as in BUILT, once BUILT
    patch_nodes: KnownPatchIndices = None  # of the moving patches, one after the other, each in the order of UPLOAD


@dataclass(frozen=True, kw_only=True, eq=False)
class Upload(SessionMessage):
    """One part of a partition's mesh. Parts of one ``item`` and ``name`` are appended in the order they come.

    item        name              rows
    nodes       —                 (k, dimension) <f8 coordinates
    global_ids  —                 (k, 1) <i8; only with partitions > 1, where they are required
    cells       the cell type     (k, nodes of the type) <i8 local node indices, 0-based; (k, 0) if they stay with the
                                  client (section 23)
    facets      the facets' type  (k, nodes of the type) <i8 local node indices; only where the cells stay there
    near_cells  the cell type     (k, nodes of the type) <i8 local node indices; only there, for layers (section 23)
    patch       the patch's name  (k, 1) <i8 local node indices; ``role`` is required
    """

    type: ClassVar[str] = "UPLOAD"
    item: Annotated[str, Choice(("nodes", "global_ids", "cells", "facets", "near_cells", "patch"))]  # what the rows are
    name: Name = ""  # of the type of cells or facets, or the patch
    role: Role = ""  # with item = "patch"
    rows: UploadRows = None  # required; shape and dtype depend on the item: section 13


@dataclass(frozen=True, kw_only=True, eq=False)
class Uploaded(Message):
    """Answer to UPLOAD: how many rows of this item and name the partition has now."""

    type: ClassVar[str] = "UPLOADED"
    rows_total: int  # rows of this item and name so far


@dataclass(frozen=True, kw_only=True, eq=False)
class Build(SessionMessage):
    """Collective: the mesh is complete; check it, make it durable, become READY."""

    type: ClassVar[str] = "BUILD"
    reach: Reach = None  # the cells about the nodes within it of the moving walls were sent, for layers: section 23


@dataclass(frozen=True, kw_only=True, eq=False)
class Built(Message):
    """The session is READY at step 0. ``moving_nodes``: this partition's local indices of the nodes whose displacement
    every MOVE must give, ascending; the rows of MOVE.displacement are in this order.
    """

    type: ClassVar[str] = "BUILT"
    step: int  # 0
    settings: dict[str, Any]  # the settings in force, defaults filled in
    mesh: dict[str, Any]  # counts, bounding box, warnings: section 15
    quality: dict[str, Any]  # summary of the mesh as uploaded: section 15
    derivatives: bool = False  # whether TANGENT and COTANGENT are answered: section 24
    reach: float = 0.0  # nothing is built yet: the cells about the nodes within it of the wall are needed: section 23
    moving_nodes: MovingIndices  # local indices, ascending: the order of the rows of MOVE
    wall: WallFacets = None  # with a reach: the corners of the moving walls' facets, one after the other


@dataclass(frozen=True, kw_only=True, eq=False)
class Move(SessionMessage):
    """Collective: one coupling iteration of the step ``step``. Any earlier trial of the step is replaced.
    ``frame`` has no default: totals taken for increments would be a valid motion, and a wrong one.
    """

    type: ClassVar[str] = "MOVE"
    step: Count  # committed step + 1
    frame: Frame  # displacement since the "reference" mesh (total), or since the "committed" state (increment)
    report: Report = ""  # in addition: "faces" as a finite-volume code sees them, the "headroom", or volumes "swept"
    headroom_along: HeadroomAlong = "step"  # the way on whose multiples the headroom counts: section 15
    time: Time = None  # of the step, seconds, later than that of the committed state: section 25
    velocity: TimeScheme = ""  # the scheme of MOVED's velocity: section 25
    compute_limit_ms: Count = 0  # the server gives up computing after so many milliseconds: section 7; 0 = never
    memory: dict[str, Any] = field(default_factory=dict)  # where MOVED may put large arrays: section 22; not content
    field_known: bool = False  # only the coefficients of the field are requested: section 23
    displacement: FloatMoving  # of the moving nodes (BUILT.moving_nodes), mesh length unit
    boundary_velocity: FloatMovingIfGiven = None  # of the moving nodes, with the velocity "tangent"
    swept_faces: CornerNodes = None  # with the report "swept", the nodes of each face; left out: all faces of the cells


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved(Message):
    """The trial: displacements of all of the partition's nodes, in the frame of the MOVE."""

    type: ClassVar[str] = "MOVED"
    step: int  # as asked
    iteration: int  # 1, 2, … within the step
    quality: dict[str, Any]  # predicted, "standard" and "corrected": section 15
    correction: dict[str, Any]  # what was done: method, enrichment points, freed nodes, iterations, reached
    caches: dict[str, Any]  # {kind: "reused" | "made", "bytes": {kind: int}}
    seconds: dict[str, float]  # solve, predict, correct, displace, total
    warnings: list[str]  # for people
    faces: dict[str, Any] = field(default_factory=dict)  # "before" and "after", where MOVE asked: section 15
    headroom: dict[str, Any] = field(default_factory=dict)  # steps until the mesh ends, where MOVE asked: section 15
    sums: list[dict[str, Any]] = field(default_factory=list)  # of the field, where the client evaluates it: section 23
    displacement: FloatNodes  # of all nodes of the partition, since the frame of the MOVE
    velocity: FloatNodesIfAsked = None  # of all nodes of the partition, where MOVE asked: section 25
    swept: SweptVolumes = None  # of the faces, where MOVE asked: section 25
    enrichment_points: FloatEnrichment  # where enrichment functions were added
    centres: FieldCentres = None  # of the field: section 23
    boxes: FieldBoxes = None  # of the field
    coefficients: FieldCoefficients = None  # of the field


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent(SessionMessage):
    """Collective: J v, the velocities of all nodes for velocities of the moving ones: section 24."""

    type: ClassVar[str] = "TANGENT"
    what: Which = "committed"  # the state at which the motion is differentiated
    velocity: MovingVectors  # of the moving nodes (BUILT.moving_nodes); the components of one vector after the other


@dataclass(frozen=True, kw_only=True, eq=False)
class TangentFound(Message):
    """Answer to TANGENT."""

    type: ClassVar[str] = "TANGENT_FOUND"
    step: int  # last committed step
    iteration: int  # of the trial at which it is; 0 = the committed state
    velocity: NodeVectors  # of all nodes of the partition, in the columns of TANGENT
    coefficients: FieldColumns = None  # of the field of velocities, where the client evaluates it: section 24
    freed: FreedIds = None  # global ids of the nodes that the correction frees
    freed_velocity: FreedVectors = None  # of these


@dataclass(frozen=True, kw_only=True, eq=False)
class Cotangent(SessionMessage):
    """Collective: Jᵀ w, the derivative of Σ w · x over all nodes by the moving ones' positions: section 24."""

    type: ClassVar[str] = "COTANGENT"
    what: Which = "committed"  # the state at which the motion is differentiated
    weights: NodeVectors  # of all nodes of the partition; the components of one vector after the other
    coefficients: FieldColumns = None  # what its other nodes count for those of the field: section 24
    region: RegionIds = None  # global ids of those of its other nodes that CORRECT sent, which do not count there
    region_weights: RegionVectors = None  # of these


@dataclass(frozen=True, kw_only=True, eq=False)
class CotangentFound(Message):
    """Answer to COTANGENT."""

    type: ClassVar[str] = "COTANGENT_FOUND"
    step: int  # last committed step
    iteration: int  # of the trial at which it is; 0 = the committed state
    weights: MovingVectors  # of the partition's moving nodes, in the columns of COTANGENT


@dataclass(frozen=True, kw_only=True, eq=False)
class Judge(SessionMessage):
    """Collective: the quality of the partition's cells in the trial of ``step``, where the client judges them."""

    type: ClassVar[str] = "JUDGE"
    step: Count  # committed step + 1
    part: dict[str, Any]  # cells, inverted, sums, minima: section 23
    questions: list[dict[str, Any]]  # the bins that are counted, the same of all partitions
    bins: JudgedBins  # question, bin, number of values in it
    values: JudgedValues  # question, value, how often it occurs
    worst: JudgedCells  # type, cell, metric, size, skew, size_skew, centre


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged(Message):
    """The quality of all cells, or further bins that it takes."""

    type: ClassVar[str] = "JUDGED"
    step: int  # as asked
    questions: list[dict[str, Any]]  # bins to be counted in addition to the request's; empty: the trial is judged
    quality: dict[str, Any]  # as in MOVED: section 15; empty while there are questions
    reached: bool  # the quality is at or above the threshold
    warnings: list[str]  # for people
    correction: dict[str, Any] = field(default_factory=dict)  # as in MOVED, once the trial is corrected
    region: dict[str, Any] = field(default_factory=dict)  # cells that the next CORRECT sends; empty: none


@dataclass(frozen=True, kw_only=True, eq=False)
class Correct(SessionMessage):
    """Collective: the partition's cells in the region that is corrected, where the client judges them."""

    type: ClassVar[str] = "CORRECT"
    step: Count  # committed step + 1
    what: Which = "trial"  # which coordinates
    part: dict[str, Any]  # the region; cells, interior, least: section 23
    nodes: RegionTold  # global id, and whether all cells of the partition at it are sent
    points: RegionPlaces  # of these nodes, in the reference mesh
    positions: RegionPlaces  # where the field takes them
    corners: RegionCorners  # of the cells, type after type: rows of nodes


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected(Message):
    """The displacements of corrected nodes, or the larger region that the correction needs."""

    type: ClassVar[str] = "CORRECTED"
    step: int  # as asked
    region: dict[str, Any]  # as in JUDGED; empty: the region is corrected
    nodes: RegionNodes  # global ids: of the freed nodes, or of those about which the larger region lies too
    displacement: RegionDisplacement  # of the freed nodes, since the reference mesh


@dataclass(frozen=True, kw_only=True, eq=False)
class Commit(SessionMessage):
    """Collective: the trial of ``step`` becomes the committed state; when it is durable says section 21."""

    type: ClassVar[str] = "COMMIT"
    step: Count  # committed step + 1
    time: Time = None  # of the step, seconds; left out: that of its last MOVE, if it had one: section 25
    final_step: Count = 0  # the step that the run ends with, as far as the client knows, for people; 0 = unknown


@dataclass(frozen=True, kw_only=True, eq=False)
class Committed(Message):
    """The step is committed."""

    type: ClassVar[str] = "COMMITTED"
    step: int  # as asked
    durable_step: int  # no power loss goes back to an earlier step; ``step``, or with durability "relaxed" at most that
    digest: Digest  # of the committed state: section 16
    quality: dict[str, Any]  # summary of the committed mesh, from its coordinates: section 15


@dataclass(frozen=True, kw_only=True, eq=False)
class Rollback(SessionMessage):
    """Collective: the trial of ``step``, if any, is dropped."""

    type: ClassVar[str] = "ROLLBACK"
    step: Count  # committed step + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class RolledBack(Message):
    """The session is READY at its last committed step."""

    type: ClassVar[str] = "ROLLED_BACK"
    step: int  # last committed step


@dataclass(frozen=True, kw_only=True, eq=False)
class Fetch(SessionMessage):
    """Asks for the partition's node coordinates. ``what``: "committed" | "reference"."""

    type: ClassVar[str] = "FETCH"
    what: Frame = "committed"  # which coordinates


@dataclass(frozen=True, kw_only=True, eq=False)
class Fetched(Message):
    """Answer to FETCH."""

    type: ClassVar[str] = "FETCHED"
    step: int  # last committed step
    region: dict[str, Any] = field(default_factory=dict)  # as in JUDGED, if these coordinates were corrected
    sums: list[dict[str, Any]] = field(default_factory=list)  # as in MOVED, where the client evaluates the field
    points: FloatNodes  # coordinates of all nodes of the partition
    centres: FieldCentres = None  # as in MOVED
    boxes: FieldBoxes = None  # as in MOVED
    coefficients: FieldCoefficients = None  # as in MOVED
    nodes: RegionIds = None  # global ids of the reference mesh' nodes, where cells were sent for layers: section 23


@dataclass(frozen=True, kw_only=True, eq=False)
class Status(SessionMessage):
    """Asks where the session stands."""

    type: ClassVar[str] = "STATUS"


@dataclass(frozen=True, kw_only=True, eq=False)
class StatusReport(Message):
    """Answer to STATUS. ``waiting_for``: partitions a collective request is still waiting for."""

    type: ClassVar[str] = "STATUS_REPORT"
    state: str  # a state of the session table
    step: int  # last committed step
    iteration: int  # moves of the open trial, 0 = none
    waiting_for: list[int]  # partitions that a collective request is still waiting for
    report: dict[str, Any]  # counters, memory, quality of the last commit
    durable_step: int = 0  # no power loss goes back to an earlier step


@dataclass(frozen=True, kw_only=True, eq=False)
class Close(SessionMessage):
    """Ends this holder's use. ``outcome``: "keep" leaves the session durable and resumable, "discard" deletes it."""

    type: ClassVar[str] = "CLOSE"
    outcome: Outcome = "keep"  # one partition's "discard" discards, once all of this epoch have closed


@dataclass(frozen=True, kw_only=True, eq=False)
class Closed(Message):
    """The session's worker is about to end."""

    type: ClassVar[str] = "CLOSED"
    step: int  # the step that RESUME will find

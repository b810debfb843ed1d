"""The parts of replies about quality, mesh and correction: plain values, with cells in the sender's numbering."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from mesh_motion_numerics.mesh.finite_volume import FaceMeasures
from mesh_motion_numerics.mesh.points import bounding_box
from mesh_motion_numerics.method import Method

from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.session import Session

if TYPE_CHECKING:
    from mesh_motion_numerics.correction.correction import Correction
    from mesh_motion_numerics.motion.motion_found import Motion
    from mesh_motion_numerics.quality.headroom import Headroom
    from mesh_motion_numerics.quality.quality_summary import Judgement

#: Longest list of warnings or patches in a reply: the header holds at most 256 items each.
_LONGEST = 100
_WORST = 10  # cells, as SPEC.md has it


def summary_report(summary: Judgement, mesh: MergedMesh) -> dict[str, Any]:
    """The quality of a mesh, as sent.

    Parameters
    ----------
    summary : QualitySummary or LowestQuality
    mesh : MergedMesh
        Names the worst cells by partition, type and local index.
    """
    report: dict[str, Any] = {name: asdict(found) for name, found in summary.reported.items()}
    report |= {"inverted": int(summary.inverted), "cells": int(summary.cells)}
    report["worst"] = [
        _place(mesh, cell.number)
        | {
            "centre": [float(x) for x in cell.centre],
            "size": float(cell.size),
            "skew": float(cell.skew),
            "size_skew": float(cell.size_skew),
            "metric": float(cell.value),
        }
        for cell in summary.worst[:_WORST]
    ]
    return report


def move_quality(motion: Motion, session: Session) -> dict[str, Any]:
    """Predicted quality of a Move, before and after correction; if the client judges it, only metric and threshold."""
    method = session.model.method
    if motion.field is not None:
        return quality_frame(method)
    standard = summary_report(motion.standard, session.mesh)
    unchanged = motion.corrected is motion.standard  # not corrected: one judgement, so one report
    return quality_frame(method) | {
        "standard": standard,
        "corrected": standard if unchanged else summary_report(motion.corrected, session.mesh),
    }


def quality_frame(method: Method) -> dict[str, Any]:
    """The metric and the threshold by which a motion is judged."""
    return {"metric": method.quality_metric, "threshold": float(method.quality_threshold)}


def faces_report(faces: tuple[FaceMeasures, ...], mesh: MergedMesh) -> dict[str, Any]:
    """FaceMeasures of the reference mesh and of the answer, as sent; empty without them."""
    return {
        name: measures.numbers()
        | {
            "worst": [
                _place(mesh, face.cells[0])
                | {
                    "neighbour": _place(mesh, face.cells[1]),
                    "centre": list(face.centre),
                    "non_orthogonality": face.non_orthogonality,
                }
                for face in measures.worst
            ]
        }
        for name, measures in zip(("before", "after"), faces, strict=False)
    }


def headroom_report(headroom: Headroom, mesh: MergedMesh) -> dict[str, Any]:
    """The headroom, as sent: values beyond the horizon are left out."""
    steps = {"inversion": headroom.inversion, "threshold": headroom.threshold}
    found: dict[str, Any] = {name: value for name, value in steps.items() if math.isfinite(value)}
    # the cell is the first one that inverts: without an inversion there is none
    return found | ({"cell": _place(mesh, headroom.cell)} if "inversion" in found else {})


def correction_report(motion: Motion) -> dict[str, Any]:
    """The result of the correction, as sent."""
    return _what_was_done(motion.correction, motion.reached) | {
        "control_points": len(motion.control_points),
        "support_radius": float(motion.support_radius),
        "sub_steps": int(motion.sub_steps),
    }


def region_correction_report(correction: Correction, session: Session) -> dict[str, Any]:
    """The result of the correction of a region, as sent."""
    radius = session.model.method.support_radius
    return _what_was_done(correction, correction.reached) | {
        "control_points": len(session.mesh.on_patches),
        "support_radius": float(radius or 0.0),
        "sub_steps": 1,
    }


def _what_was_done(correction: Correction, reached: bool) -> dict[str, Any]:
    return {
        "method": str(correction.method),
        "enrichment_points": len(correction.enrichment_points),
        "freed_nodes": int(correction.freed_nodes),
        "iterations": int(correction.iterations),
        "reached": bool(reached),
    }


def mesh_report(session: Session, warnings: list[str] | None = None) -> dict[str, Any]:
    """Counts, bounding box and warnings of a mesh that was just built; given ``warnings`` replace a second check."""
    mesh = session.mesh
    patches = list(mesh.patches.items())[:_LONGEST]
    return {
        "nodes": len(mesh.points),
        "cells": {origin.type_name: len(origin) for origin in mesh.cell_origins},
        "patches": {name: {"role": patch.role, "nodes": len(patch.nodes)} for name, patch in patches},
        "moving_nodes": len(mesh.moving),
        "box": bounding_box(mesh.points).tolist(),
        "warnings": shortened(session.mesh_warnings() if warnings is None else warnings),
    }


def shortened(warnings: list[str]) -> list[str]:
    """The first warnings, as many as a reply may hold, and the number of the others."""
    if len(warnings) <= _LONGEST:
        return warnings
    return [*warnings[:_LONGEST], f"and {len(warnings) - _LONGEST} more"]


def worst_places(cells: tuple[int, ...], mesh: MergedMesh) -> list[dict[str, Any]]:
    """Canonical cell numbers as partition, type and local index."""
    return [_place(mesh, cell) for cell in cells[:_WORST]]


def _place(mesh: MergedMesh, cell: int) -> dict[str, Any]:
    partition, type_name, local = mesh.locate_cell(cell)
    return {"partition": partition, "type": type_name, "cell": local}

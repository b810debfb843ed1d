"""The cases for servers: one module for each section of SPEC.md or for a few sections, in SPEC.md's order."""

from __future__ import annotations

from mesh_motion_conformance.case import Case
from mesh_motion_conformance.server import (  # noqa: F401 the modules add their cases to the suite
    section_02_transport,
    section_03_frames,
    section_04_header,
    section_05_arrays,
    section_06_limits,
    section_07_session,
    section_08_states,
    section_09_partitions,
    section_10_exactly_once,
    section_11_resume,
    section_12_messages,
    section_13_mesh,
    section_14_settings,
    section_15_reports,
    section_17_errors,
    section_21_durability,
    section_23_client_evaluation,
    section_24_derivatives,
    section_25_velocities,
    vectors,
)
from mesh_motion_conformance.server.stage import Stage, suite

__all__ = ["Stage", "server_cases"]


def server_cases() -> list[Case]:
    """All cases for servers, in an order in which they can share sessions."""
    return list(suite)

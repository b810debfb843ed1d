"""The cases for servers: one module for each section of SPEC.md or for a few sections, in SPEC.md's order."""

from __future__ import annotations

from mesh_motion_conformance.case import Case
from mesh_motion_conformance.server import (
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
from mesh_motion_conformance.server.stage import Stage

__all__ = ["Stage", "server_cases"]

_SUITES = (
    section_02_transport.suite,
    section_03_frames.suite,
    section_04_header.suite,
    section_05_arrays.suite,
    section_06_limits.suite,
    section_07_session.suite,
    section_08_states.suite,
    section_09_partitions.suite,
    section_10_exactly_once.suite,
    section_11_resume.suite,
    section_12_messages.suite,
    section_13_mesh.suite,
    section_14_settings.suite,
    section_15_reports.suite,
    section_17_errors.suite,
    section_21_durability.suite,
    section_23_client_evaluation.suite,
    section_24_derivatives.suite,
    section_25_velocities.suite,
    vectors.suite,
)


def server_cases() -> list[Case]:
    """All cases for servers, in an order in which they can share sessions."""
    return [case for suite in _SUITES for case in suite]

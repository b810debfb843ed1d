"""Which modules are mutated, and which tests should notice it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["TARGETS"]

_STORED = (
    "tests/session/test_records.py",
    "tests/session/test_recovery.py",
    "tests/session/test_journal.py",
    "tests/session/test_golden_journals.py",
    "tests/session/test_durability.py",
    "tests/session/test_store.py",
)
_SESSION = (
    "tests/session/test_replies.py",
    "tests/session/test_state.py",
    "tests/session/test_session.py",
    "tests/session/test_durability.py",
    "tests/session/test_store.py",
    "tests/service/test_dispatch.py",
)
_PROTOCOL = (
    "tests/protocol/test_codec.py",
    "tests/protocol/test_header.py",
    "tests/protocol/test_schema.py",
    "tests/protocol/test_vectors.py",
    "tests/protocol/test_digests.py",
)

_MODULES = {
    **dict.fromkeys(
        (
            "mesh_motion_server.session.journal",
            "mesh_motion_server.session.journal_files",
            "mesh_motion_server.session.recovery",
            "mesh_motion_server.session.ledger",
            "mesh_motion_server.session.records",
            "mesh_motion_server.session.store",
        ),
        _STORED,
    ),
    **dict.fromkeys(
        (
            "mesh_motion_server.session.replies",
            "mesh_motion_server.session.state",
            "mesh_motion_server.session.session",
        ),
        _SESSION,
    ),
    **dict.fromkeys(
        (
            "mesh_motion_protocol.codec",
            "mesh_motion_protocol.header",
            "mesh_motion_protocol.arrays",
            "mesh_motion_protocol.digests",
            "mesh_motion_protocol.schema",
        ),
        _PROTOCOL,
    ),
}

#: Module → test files, the telling ones first.
TARGETS: Mapping[str, tuple[str, ...]] = MappingProxyType(_MODULES)

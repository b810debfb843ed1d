"""Which modules are mutated, and which tests should notice it.

Left out are ``durability`` and ``relaxed`` (the levels, and the thread behind one), ``replay`` and ``motions`` (what is
computed), ``uploads``, and ``standing``, which holds values only: other proofs look at what these do as a whole.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["TARGETS", "Target"]


@dataclass(frozen=True)
class Target:
    """Test files of a module.

    Attributes
    ----------
    tests : tuple of str
        Collected together with those of other modules; of the tests that call a mutated function the quickest are run.
    own : tuple of str
        Of these each one that calls it.
    """

    tests: tuple[str, ...]
    own: tuple[str, ...]


_STORED = (
    *(
        f"tests/session/journal/test_{name}.py"
        for name in (
            "ledger",
            "records",
            "recovery",
            "witness",
            "journal",
            "journal_at_rest",
            "journal_files",
            "next_manifest",
            "golden_journals",
            "power_loss",
            "durability",
        )
    ),
    *(f"tests/session/test_{name}.py" for name in ("store", "store_files", "listing")),
)
_SESSION = (
    "tests/session/journal/test_replies.py",
    "tests/session/test_state.py",
    "tests/session/test_session.py",
    "tests/session/test_commit_quality.py",
    "tests/session/journal/test_durability.py",
    "tests/session/test_store.py",
    "tests/service/test_dispatch.py",
    "tests/service/test_states.py",
    "tests/service/test_exactly_once.py",
    "tests/service/test_quality_report.py",
)
_NUMERICS = {
    "quality.orientation": ("orientation",),
    "quality.quality_summary": ("quality_summary", "order_statistics"),
}
_PROTOCOL = tuple(
    f"tests/protocol/test_{name}.py" for name in ("codec", "header", "schema", "vectors", "digests", "shared_memory")
)


def _targets(package: str, tests: tuple[str, ...], own: Mapping[str, tuple[str, ...]]) -> dict[str, Target]:
    return {f"{package}.{name}": Target(tests, tuple(f"test_{each}.py" for each in of)) for name, of in own.items()}


#: Module → its tests.
TARGETS: Mapping[str, Target] = MappingProxyType(
    _targets(
        "mesh_motion_server.session",
        _STORED,
        {
            "journal.ledger": ("ledger", "recovery"),
            "journal.records": ("records",),
            "journal.recovery": ("recovery",),
            "journal.witness": ("witness", "recovery"),
            "journal.files": ("journal_files", "journal"),
            "journal.next_manifest": ("next_manifest", "journal", "journal_at_rest"),
            "journal.journal": ("journal", "journal_at_rest", "power_loss"),
            "store": ("store", "store_files", "listing"),
        },
    )
    | _targets(
        "mesh_motion_server.session",
        _SESSION,
        {
            "journal.replies": ("replies",),
            "state": ("state",),
            "position": ("session", "durability"),
            "session": ("session", "durability", "quality_report"),
        },
    )
    | _targets(
        "mesh_motion_protocol",
        _PROTOCOL,
        {name: (name, "codec", "vectors") for name in ("codec", "header", "arrays", "digests", "schema")},
    )
    | _targets(
        "mesh_motion_server.numerics",
        tuple(f"tests/numerics/test_{name}.py" for names in _NUMERICS.values() for name in names),
        _NUMERICS,
    )
)

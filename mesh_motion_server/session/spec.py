"""The values that OPEN fixes for a session's whole life, and their stored form."""

from __future__ import annotations

import hashlib
import hmac
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import DataLoss, InvalidInput

from mesh_motion_server.session.journal.filesystem import PosixFileSystem, read_whole, unreadable
from mesh_motion_server.settings import MethodSettings

SPEC = "spec.json"
"""The file in a session's folder with the values that OPEN fixed."""

MOST_SPEC_BYTES = 1 << 20
"""What OPEN fixes comes in a header of at most 64 KiB; defaults are filled in."""

#: A version refuses files of another format, so every incompatible change needs another number.
_FORMAT = 1
#: Values that have no key, so that versions which do not know the key can read the file.
_USUAL = {"owner": "", "evaluation": "server", "time": 0.0, "time_levels": ""}


@dataclass(frozen=True)
class SessionSpec:
    """The values that OPEN fixes for a session's whole life."""

    session: str  # 32 hexadecimal digits
    token: bytes = field(repr=False)  # 32 bytes; only its sha256 is ever stored
    dimension: int
    partitions: int = 1
    settings: MethodSettings = field(default_factory=MethodSettings)
    label: str = ""
    durability: str = "full"  # one of :data:`mesh_motion_server.settings.DURABILITY_LEVELS`
    owner: str = ""  # the public key of the user who opened it; empty on a server without keys
    evaluation: str = "server"  # {"server", "client"}. The side that moves and judges the volume
    time: float = 0.0  # time of the reference mesh, seconds
    time_levels: str = ""  # one of :data:`~mesh_motion_numerics.motion.time_levels.STORED_ARRAYS`


@dataclass(frozen=True)
class StoredSpec:
    """The spec without its token, as ``spec.json`` has it: JSON with these attributes as keys.

    ``owner`` and the attributes after it are written only if they differ from their defaults.
    """

    session: str
    token_sha256: str  # hexadecimal
    dimension: int
    partitions: int
    settings: MethodSettings  # with defaults, so that a later version with other defaults computes the same
    label: str
    durability: str
    owner: str = ""
    evaluation: str = "server"
    time: float = 0.0
    time_levels: str = ""

    @classmethod
    def of(cls, spec: SessionSpec) -> StoredSpec:
        """The stored form of a spec."""
        return cls(
            session=spec.session,
            token_sha256=hashlib.sha256(spec.token).hexdigest(),
            dimension=spec.dimension,
            partitions=spec.partitions,
            settings=spec.settings,
            label=spec.label,
            durability=spec.durability,
            owner=spec.owner,
            evaluation=spec.evaluation,
            time=spec.time,
            time_levels=spec.time_levels,
        )

    def admits(self, token: bytes) -> bool:
        """Whether this is the session's token; takes the same time for every wrong one."""
        return hmac.compare_digest(hashlib.sha256(token).hexdigest(), self.token_sha256)

    def require_cells(self) -> None:
        """Raise InvalidInput if the server does not have the cells, because the client evaluates the field."""
        if self.evaluation == "client":
            raise InvalidInput(f"session {self.session}: the client has its cells, the server does not")

    def to_bytes(self) -> bytes:
        """The file's content."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        values |= {"format": _FORMAT, "settings": self.settings.model_dump()}
        for name, usual in _USUAL.items():
            if values[name] == usual:
                del values[name]
        return json.dumps(values, indent=1, sort_keys=True, allow_nan=False).encode() + b"\n"

    @classmethod
    def from_bytes(cls, data: bytes) -> StoredSpec:
        """The inverse of :meth:`to_bytes`.

        Raises DataLoss if the content is not valid; UNIMPLEMENTED.VERSION if another version wrote it.
        """
        try:
            values: dict[str, Any] = json.loads(data)
            _check_version(values.pop("format"), values["settings"])
            return cls(**values | {"settings": MethodSettings.from_mapping(values["settings"])})
        except DataLoss:
            raise
        except Exception as error:
            raise DataLoss(
                f"the session's spec cannot be read: {error}",
                hint="restore the session's folder from a backup, or discard the session",
                details={"file": SPEC},
            ) from error


def _check_version(number: Any, settings: dict[str, Any]) -> None:
    """Raise unless this version knows the format and every setting: an unknown one would lose its meaning."""
    unknown = sorted(set(settings) - set(MethodSettings.model_fields))
    if number == _FORMAT and not unknown:
        return
    what = f"has the settings {', '.join(unknown)}" if number == _FORMAT else f"has format {number}"
    raise DataLoss(
        f"the session's spec {what}, which this version does not know; it reads format {_FORMAT}",
        code="UNIMPLEMENTED.VERSION",
        hint="open it with the version of the server that wrote it; nothing was changed",
        details={"file": SPEC, "got": number, "expected": _FORMAT},
    )


def check_digest(spec: bytes, expected: bytes) -> None:
    """Raise DATA_LOSS.CHECKSUM unless these bytes of ``spec.json`` have the sha256 in the journal."""
    if hashlib.sha256(spec).digest() != expected:
        raise DataLoss(
            "the session's spec does not match its digest",
            hint="restore the session's folder from a backup, or discard the session",
            details={"file": SPEC},
        )


def spec_bytes(folder: Path) -> bytes:
    """The content of a session's ``spec.json``.

    Raises DataLoss if there is no such file: the folder is not a session's. Raises RESOURCE_EXHAUSTED.DISK if the file
    cannot be read.
    """
    try:
        return read_whole(PosixFileSystem(), folder / SPEC, MOST_SPEC_BYTES)
    except OSError as error:
        if not isinstance(error, FileNotFoundError | NotADirectoryError):
            raise unreadable("the session's spec", error) from error
        raise DataLoss(
            f"{folder} is not a session's folder: {error.strerror or error}",
            hint="give a folder below STATE FOLDER/sessions, or a copy of one",
        ) from error

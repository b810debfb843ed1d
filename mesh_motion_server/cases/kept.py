"""The data that a run keeps until it ends without an error: enough to resume after the last committed step.

The folder ``.session`` in the results has the session's credentials, a private server's state, the request, a line for
each step, and the coordinates after the worst step.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.cases.records import StepRecord
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats

__all__ = ["KEPT", "Kept"]

KEPT = ".session"


@dataclass(frozen=True)
class Kept:
    """The folder; it may be missing."""

    folder: Path

    @property
    def state(self) -> Path:
        """State folder of a private server."""
        return self.folder / "state"

    @property
    def credentials(self) -> Path:
        """Credentials of the session."""
        return self.folder / "credentials.json"

    @property
    def is_empty(self) -> bool:
        """Whether no step is kept."""
        return not self._steps.exists()

    def begin(self, asked: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        """Keep the request, which is compared when the run resumes, and the settings in force."""
        self._run.write_text(json.dumps({"asked": asked, "settings": settings}), encoding="utf-8")

    def settings(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The settings in force.

        Raises
        ------
        InvalidInput
            If nothing is kept, or the kept request is a different one.
        """
        try:
            known = json.loads(self._run.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise InvalidInput(
                f"{self.folder.parent}: no unfinished run is kept there", hint="play without --resume"
            ) from None
        changed = sorted(name for name in asked if asked[name] != known["asked"].get(name))
        if changed:
            raise InvalidInput(
                f"{self.folder.parent}: the steps that are kept were played with another {', '.join(changed)}",
                hint="put it back, or play from the beginning without --resume",
            )
        settings: dict[str, Any] = known["settings"]
        return settings

    def add(self, record: StepRecord, warnings: list[str]) -> None:
        """Keep a step that is about to be committed, and all warnings so far."""
        line = json.dumps({"record": record.as_dict(), "warnings": warnings})
        with self._steps.open("a", encoding="utf-8") as file:
            file.write(line + "\n")

    def steps(self, committed: int) -> tuple[list[StepRecord], list[str]]:
        """The steps up to the committed one, and their warnings; later steps are dropped.

        Raises
        ------
        InvalidInput
            If a step is missing.
        """
        lines = self._steps.read_text(encoding="utf-8").splitlines(keepends=True) if self._steps.exists() else []
        if len(lines) < committed:
            raise InvalidInput(
                f"{self.folder}: the session is at step {committed}, and {len(lines)} steps are kept",
                hint="play from the beginning without --resume",
            )
        self._steps.write_text("".join(lines[:committed]), encoding="utf-8")
        found = [json.loads(line) for line in lines[:committed]]
        return [StepRecord(**one["record"]) for one in found], found[-1]["warnings"] if found else []

    def keep_worst(self, step: int, points: Floats) -> None:
        """Keep the coordinates (n, d) after the worst step so far."""
        np.save(self.folder / f"worst_{step}.npy", points, allow_pickle=False)
        for other in self.folder.glob("worst_*.npy"):
            if other.name != f"worst_{step}.npy":
                other.unlink()

    def worst(self, step: int) -> Floats | None:
        """Coordinates after the worst step; None if another step is kept."""
        path = self.folder / f"worst_{step}.npy"
        return np.load(path, allow_pickle=False) if path.exists() else None

    @property
    def _run(self) -> Path:
        return self.folder / "run.json"

    @property
    def _steps(self) -> Path:
        return self.folder / "steps.jsonl"

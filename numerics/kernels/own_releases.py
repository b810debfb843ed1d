"""The requirements of a distribution of this repository: its own parts, in the same version, and other packages."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

__all__ = ["dynamic_metadata", "dynamic_metadata_needs"]


def dynamic_metadata(field: str, settings: Mapping[str, Any], project: Mapping[str, Any]) -> list[str]:
    """Return the dependencies for scikit-build-core; ``build_backend`` may name folders of own parts."""
    del field
    folders = json.loads(os.environ.get("MESH_MOTION_PARTS", "{}"))
    own = [part + folders.get(part, f"=={project['version']}") for part in settings["parts"]]
    return [*own, *settings.get("others", [])]


def dynamic_metadata_needs(field: str, settings: Mapping[str, Any]) -> list[str]:
    """Return the names of the fields from which the requirements are made."""
    del field, settings
    return ["version"]

"""The server's requirement of the client: the release of its own version, or what ``build_backend`` names."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

__all__ = ["dynamic_metadata", "dynamic_metadata_needs"]


def dynamic_metadata(field: str, settings: Mapping[str, Any], project: Mapping[str, Any]) -> list[str]:
    """The dependencies, as scikit-build-core asks a plug-in for them."""
    del field, settings
    return ["mesh-motion-client" + os.environ.get("MESH_MOTION_CLIENT", f"=={project['version']}")]


def dynamic_metadata_needs(field: str, settings: Mapping[str, Any]) -> list[str]:
    """What the requirement is made from."""
    del field, settings
    return ["version"]

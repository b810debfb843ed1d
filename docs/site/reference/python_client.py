"""The Python client's public names, from their docstrings."""

from __future__ import annotations

import mesh_motion_client

__all__ = ["python_client"]

#: In the order in which a program meets them; the errors follow.
_FIRST = ("connect", "Server", "Session", "Mesh", "Patch", "Credentials", "Keys")
#: Methods by which the client's own modules work together.
_INNER = {"Session": ("join", "upload"), "Mesh": ("parts",), "Keys": ("protect",), "Server": ("embedded",)}


def python_client() -> str:
    """Directives for every name of ``mesh_motion_client.__all__``."""
    errors = sorted(set(mesh_motion_client.__all__) - set(_FIRST), key=lambda name: (name != "MeshMotionError", name))
    parts = [f"## {name}\n\n{_directive(name)}" for name in _FIRST]
    return "\n".join([*parts, "## Errors\n", *map(_directive, errors)])


def _directive(name: str) -> str:
    """autodoc's directive for one name."""
    value = getattr(mesh_motion_client, name)
    if not isinstance(value, type):
        lines = [f".. autofunction:: mesh_motion_client.{name}"]
    else:
        lines = [f".. autoclass:: mesh_motion_client.{name}", "   :members:"]
        lines += [f"   :exclude-members: {', '.join(_INNER[name])}"] if name in _INNER else []
        lines += ["   :show-inheritance:"] if issubclass(value, Exception) else []
    return "```{eval-rst}\n" + "\n".join(lines) + "\n```\n"

"""The messages in Python: each class with its fields, from the declarations."""

from __future__ import annotations

import inspect

from mesh_motion_protocol.messages import MESSAGES, Message
from mesh_motion_protocol.schema import schema_of

from docs.site.reference.tables import comments_behind

__all__ = ["messages"]


def messages() -> str:
    """A class description for each message."""
    return (
        "```{eval-rst}\n.. py:currentmodule:: mesh_motion_protocol.messages\n\n"
        + "".join(_class(cls) for cls in MESSAGES.values())
        + "```\n"
    )


def _class(cls: type[Message]) -> str:
    """In reStructuredText: docstring, then a list of the fields."""
    schema, meaning = schema_of(cls), comments_behind(cls)
    lines = [f".. py:class:: {cls.__name__}", f"   :canonical: {cls.__module__}.{cls.__name__}", ""]
    lines += [f"   {schema.kind}. {' '.join(_first_paragraph(cls).split())}", ""]
    for spec in schema.fields:
        kind = getattr(spec.kind, "__name__", str(spec.kind)) if not hasattr(spec.kind, "__args__") else str(spec.kind)
        lines += _field(spec.name, kind.replace("typing.", ""), spec.required, meaning.get(spec.name, ""))
    for array in schema.arrays:
        axes = ", ".join(array.axes)
        lines += _field(array.name, f"({axes}) array of {array.dtypes[0]}", array.required, meaning.get(array.name, ""))
    return "\n".join([*lines, "", ""])


def _field(name: str, kind: str, required: bool, text: str) -> list[str]:
    """An item of the list."""
    return [f"   - **{name}** (``{kind}``{'' if required else ', optional'}){': ' if text else ''}{text}"]


def _first_paragraph(cls: type[Message]) -> str:
    return (inspect.getdoc(cls) or "").split("\n\n")[0]

"""The Python client's public names, from their docstrings, as Markdown that is readable without a build."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

import mesh_motion_client
from mesh_motion_client import aio, dask_ranks, dask_worker, quality

__all__ = ["python_client"]

#: In the order in which a program meets them; the errors follow.
_FIRST = (
    "connect", "Server", "Session", "Mesh", "Patch", "Settings", "Moved", "Committed", "progress",
    "Credentials", "Keys",
)  # fmt: skip
#: Methods by which the client's own modules work together.
_INNER = {
    "Session": ("forget_correction",),
    "DaskSession": ("open", "resume"),
    "Mesh": ("parts",),
    "Keys": ("protect",),
    "Server": ("embedded",),
}
#: Classes whose objects are made by a call of another object.
_MADE_ELSEWHERE = ("Server", "Session", "Moved", "Committed", "DaskSession", "Answer")
#: An annotation as inspect shows it: quoted, for it is not evaluated.
_ANNOTATION = re.compile(r"(: |-> )'([^']*)'")
_WIDTH = 100
_ROLE = re.compile(r":[a-z]+:`~?([^`]+)`")
_EXAMPLE = re.compile(r"^::\n\n((?: {4}.*\n|\n)+)", re.MULTILINE)
_TITLE = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)


def python_client() -> str:
    """Every name of ``mesh_motion_client.__all__``, and those of :mod:`mesh_motion_client.dask_ranks`."""
    errors = sorted(set(mesh_motion_client.__all__) - set(_FIRST), key=lambda name: (name != "MeshMotionError", name))
    parts = [f"## {name}\n\n{_described(name, getattr(mesh_motion_client, name))}" for name in _FIRST]
    parts += [
        "## Errors\n",
        *(f"### {name}\n\n{_described(name, getattr(mesh_motion_client, name))}" for name in errors),
    ]
    parts += ["## Quality reports\n\nIn `mesh_motion_client.quality`.\n"]
    parts += [f"### {name}\n\n{_described(name, getattr(quality, name))}" for name in quality.__all__]
    parts += [f"## With an event loop\n\nIn `mesh_motion_client.aio`.\n\n{_markdown(aio)}"]
    workers = (dask_ranks.open_on_workers, dask_ranks.DaskSession, dask_worker.Answer)
    parts += ["## Dask workers as ranks\n\nIn `mesh_motion_client.dask_ranks`: [what for](../distributed.md).\n"]
    return "\n".join([*parts, *(f"### {of.__name__}\n\n{_described(of.__name__, of)}" for of in workers)])


def _described(name: str, value: Any) -> str:
    """A function, or a class and its public methods."""
    if not isinstance(value, type):
        return _block(_signature(name, value)) + _markdown(value)
    if issubclass(value, Exception):
        bases = ", ".join(f"`{base.__name__}`" for base in value.__bases__)
        return f"{_markdown(value)}\nA kind of {bases}.\n"
    if issubclass(value, dict):
        keys = ", ".join(f"`{key}`" for key in value.__annotations__)
        return f"{_markdown(value)}\nKeys: {keys}.\n"
    head = "" if name in _MADE_ELSEWHERE else _block(_signature(name, value))
    return "\n".join([head + _markdown(value), *(_member(name, *member) for member in _members(name, value))])


def _members(name: str, cls: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties with a docstring, in the order of their declaration."""
    for member, value in vars(cls).items():
        inner = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
        documented = isinstance(inner, property) or inspect.isfunction(inner)
        if documented and not member.startswith("_") and member not in _INNER.get(name, ()) and inner.__doc__:
            yield member, inner


def _member(owner: str, name: str, value: Any) -> str:
    called = "" if isinstance(value, property) else _block(_signature(name, value))
    return f"### {owner}.{name}\n\n{called}{_markdown(value)}"


def _signature(name: str, value: Callable[..., Any]) -> str:
    signature = inspect.signature(value)
    given = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
    shown = _ANNOTATION.sub(r"\1\2", name + str(signature.replace(parameters=given)))
    if len(shown) <= _WIDTH:
        return shown
    lines = [_ANNOTATION.sub(r"\1\2", str(parameter)) for parameter in given]
    by_name = next((k for k, parameter in enumerate(given) if parameter.kind is parameter.KEYWORD_ONLY), len(lines))
    lines[by_name:by_name] = ["*"] if by_name < len(lines) else []
    return "\n".join([f"{name}(", *(f"    {line}," for line in lines), f"){shown.rpartition(')')[2]}"])


def _block(text: str) -> str:
    return f"```python\n{text}\n```\n\n"


def _markdown(value: Any) -> str:
    """A numpydoc docstring: sections are lists, roles are code, examples are blocks."""
    text = _ROLE.sub(lambda role: f"`{role[1].rpartition('.')[2]}`", inspect.getdoc(value) or "").replace("``", "`")
    text = _EXAMPLE.sub(lambda found: _block(textwrap.dedent(found[1]).strip()), text)
    summary, *sections = _TITLE.split(text)
    parts = [summary.strip()]
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title == "Examples":
            parts.append(_block(re.sub(r"^(>>>|\.\.\.) |\s+# doctest:.*$", "", body.strip(), flags=re.M)).strip())
        else:
            parts.append(f"**{title}**\n\n" + "\n".join(_items(body.strip("\n"))))
    return "\n\n".join(parts) + "\n"


def _items(body: str) -> Iterator[str]:
    """``name : kind`` at the margin, its description indented below it."""
    for line in body.splitlines():
        if line.startswith(" "):
            yield "  " + line.strip()
        elif line:
            name, _, kind = line.partition(" : ")
            names = ", ".join(f"`{part.strip()}`" for part in name.split(","))
            yield f"- {names}{f' ({kind})' if kind else ''}"

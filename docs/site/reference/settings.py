"""Settings and the case file's keys, from the models that check them."""

from __future__ import annotations

import inspect
import re
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from docs.site.reference.tables import code, comments_behind, table
from mesh_motion_server.cases import case
from mesh_motion_server.numerics.interpolation.kernels import BASES
from mesh_motion_server.numerics.method import CHOICES, Method
from mesh_motion_server.settings import MethodSettings, ServerSettings

__all__ = ["case_file", "method_settings", "server_settings"]

_BOUNDS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
_WORDS = {str: "text", int: "integer", float: "number", bool: "true or false", list: "list", dict: "table"}


def server_settings() -> str:
    """Each key of the server's settings with its type, default and meaning."""
    meaning = comments_behind(ServerSettings)
    rows = [
        (code(key), _type(ServerSettings, key), _default(ServerSettings, key), meaning.get(key, ""))
        for key in ServerSettings.model_fields
    ]
    return table(("key", "type", "default", "meaning"), rows)


def method_settings() -> str:
    """Each key of ``[method]`` with its choices, default and meaning."""
    meaning = _attributes(inspect.getdoc(Method) or "")
    rows = []
    for key in MethodSettings.model_fields:
        choices = CHOICES.get(key) or (tuple(BASES) if key == "basis" else ())
        kind = ", ".join(code(f'"{choice}"') for choice in choices) or _type(MethodSettings, key)
        rows.append((code(key), kind, _default(MethodSettings, key), meaning.get(key, "")))
    return table(("key", "values", "default", "meaning"), rows)


def case_file() -> str:
    """The tables of a case file, each with its keys."""
    places = {
        "[mesh]": case.MeshSection,
        "[[motion]]": case.MotionSection,
        "rigid = { … } of a [[motion]]": case.RigidMotion,
        "oscillation = { … } of a [[motion]]": case.Oscillation,
        "[steps]": case.StepsSection,
    }
    parts = []
    for place, model in places.items():
        rows = [(code(key), _type(model, key), _default(model, key)) for key in model.model_fields]
        parts.append(f"### `{place}`\n\n{table(('key', 'type', 'default'), rows)}")
    roles = ", ".join(code(f'"{role}"') for role in get_args(case.Role))
    return "\n".join([*parts, f"### `[patches]`\n\nThe name of each boundary patch = its role: {roles}.\n"])


def _type(model: type[BaseModel], key: str) -> str:
    """A field's type and bounds in words."""
    return _words(get_type_hints(model, include_extras=True)[key])


def _words(hint: Any) -> str:
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _words(inner[0]) + _bounds(inner[1:])
    if origin in (UnionType, Union):
        return " or ".join(_words(kind) for kind in inner if kind is not NoneType)
    if origin is Literal:
        return ", ".join(code(f'"{value}"' if isinstance(value, str) else value) for value in inner)
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return "table"
    if origin is list:
        return f"list of {_words(inner[0])}"
    return _WORDS.get(origin or hint, getattr(hint, "__name__", str(hint)).lower())


def _bounds(markers: tuple[Any, ...]) -> str:
    """What a pydantic Field adds to the type: limits of a value, a pattern of a text."""
    parts = []
    for marker in markers:
        for bound in getattr(marker, "metadata", []):
            parts += [f"{sign} {getattr(bound, name)}" for name, sign in _BOUNDS.items() if hasattr(bound, name)]
            parts += [f"matching {code(bound.pattern)}"] if getattr(bound, "pattern", None) else []
    return f", {', '.join(parts)}" if parts else ""


def _default(model: type[BaseModel], key: str) -> str:
    """As one writes it in TOML."""
    value = model.model_fields[key].default
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "–"
    if isinstance(value, bool):
        return code(str(value).lower())
    if isinstance(value, int | float):
        return code(value)
    if isinstance(value, list | tuple):
        return code("[" + ", ".join(f'"{item}"' for item in value) + "]")
    return code(f'"{value}"')


def _attributes(docstring: str) -> dict[str, str]:
    """Attribute → text, of a numpydoc section with a line of type each."""
    section = docstring.partition("Attributes\n----------\n")[2]
    found: dict[str, str] = {}
    name = ""
    for line in section.splitlines():
        if head := re.match(r"^(\w+) : ", line):
            name = head[1]
            found[name] = ""
        elif name:
            found[name] = f"{found[name]} {line.strip()}".strip()
    return {key: _plain(text) for key, text in found.items()}


def _plain(text: str) -> str:
    """reStructuredText of a docstring as Markdown: roles lose their names."""
    text = re.sub(r":\w+:`~?\.?(?:[\w.]*\.)?(\w+)`", r"`\1`", text)
    return text.replace("``", "`")

"""Settings and the case file's keys, from the models that check them."""

from __future__ import annotations

from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from mesh_motion_numerics.method import KEYS, Key
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from docs.site.reference.tables import code, comments_behind, table
from mesh_motion_server.cases import case
from mesh_motion_server.settings import ServerSettings

__all__ = ["case_file", "method_keys", "method_settings", "server_settings"]

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
    """Each key of ``[method]`` with its choices or range, default and meaning."""
    rows = [(code(name), _values(key), _toml(key.default), key.meaning) for name, key in KEYS.items()]
    return table(("key", "values", "default", "meaning"), rows)


def method_keys() -> str:
    """Each key of ``[method]`` with when to change it, by groups."""
    parts = []
    for group in dict.fromkeys(key.group for key in KEYS.values()):
        lines = [
            f"- **`{name}`** – {_values(key)}; default {_toml(key.default)}. {key.meaning} *When:* {key.when}"
            for name, key in KEYS.items()
            if key.group == group
        ]
        parts.append(f"## {group}\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _values(key: Key) -> str:
    """Possible values of a key: its choices, or its type and range."""
    return ", ".join(code(f'"{choice}"') for choice in key.choices) or key.expected


def case_file() -> str:
    """The tables of a case file, each with its keys."""
    places = {
        "[mesh]": case.MeshSection,
        "[[motion]]": case.MotionSection,
        "rigid = { … } of a [[motion]]": case.RigidMotion,
        "oscillation = { … } of a [[motion]]": case.Oscillation,
        "bending = { … } of a [[motion]]": case.Bending,
        "[steps]": case.StepsSection,
    }
    parts = []
    for place, model in places.items():
        rows = [(code(key), _type(model, key), _default(model, key)) for key in model.model_fields]
        parts.append(f"### `{place}`\n\n{table(('key', 'type', 'default'), rows)}")
    roles = ", ".join(code(f'"{role}"') for role in get_args(case.Role))
    free = "A free one is left out: a set of nodes that is no boundary, for example of a material."
    return "\n".join([*parts, f"### `[patches]`\n\nThe name of each boundary patch = its role: {roles}. {free}\n"])


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
    """Constraints that a pydantic Field adds to the type: limits of a value, a pattern of a text."""
    parts = []
    for marker in markers:
        for bound in getattr(marker, "metadata", []):
            parts += [f"{sign} {getattr(bound, name)}" for name, sign in _BOUNDS.items() if hasattr(bound, name)]
            parts += [f"matching {code(bound.pattern)}"] if getattr(bound, "pattern", None) else []
    return f", {', '.join(parts)}" if parts else ""


def _default(model: type[BaseModel], key: str) -> str:
    """Default of a field, as written in TOML."""
    value = model.model_fields[key].default
    return "required" if value is PydanticUndefined else _toml(value)


def _toml(value: Any) -> str:
    """A value as written in TOML; a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return code(str(value).lower())
    if isinstance(value, int | float):
        return code(value)
    if isinstance(value, list | tuple):
        return code("[" + ", ".join(f'"{item}"' for item in value) + "]")
    return code(f'"{value}"')

"""Write the tables of SPEC.md from the code: ``python protocol/render_spec.py``.

Between ``<!-- table: NAME -->`` and ``<!-- end -->`` SPEC.md holds what :func:`tables` renders; a test compares them.
The meaning of a field is the comment after its declaration.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args, get_origin

from mesh_motion_numerics.method import KEYS, Key
from mesh_motion_protocol.declarations import Choice, Length, Range
from mesh_motion_protocol.errors import ERROR_CODES
from mesh_motion_protocol.limits import LIMITS
from mesh_motion_protocol.messages import COLLECTIVE, CONTROL, MESSAGES, REPLIES, Join, Message, SessionMessage
from mesh_motion_protocol.schema import ArraySpec, FieldSpec, schema_of

from mesh_motion_server.security.authorisation import MATRIX, Role
from mesh_motion_server.session.state import TABLE, Operation, State

SPEC = Path(__file__).parent / "SPEC.md"
ADDRESS = ("session", "epoch", "partition")
"""Fields of every request to a data endpoint; listed with JOIN only."""
SPEC_TABLES = "conformance/mesh_motion_conformance/spec_tables.py"
_BLOCK = re.compile(r"(<!-- table: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
_KINDS = {str: "str", bytes: "bin", int: "int", float: "float", bool: "bool", list: "array", dict: "map", Any: "any"}


def tables() -> dict[str, str]:
    """Name → table, as Markdown."""
    return {
        "requests": _requests(),
        "messages": _messages(),
        "errors": _errors(),
        "limits": _limits(),
        "states": _states(),
        "settings": _settings(),
        "authorisation": _authorisation(),
    }


def rendered(text: str) -> str:
    """SPEC.md's text with every table generated from the code."""
    known = tables()
    return _BLOCK.sub(lambda match: match[1] + known[match[2]] + match[3], text)


def _table(*rows: tuple[str, ...]) -> str:
    head, *body = rows
    lines = [head, tuple("---" for _ in head), *body]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |\n" for row in lines)


def _requests() -> str:
    rows = []
    for request, reply in REPLIES.items():
        where = "both" if request == "PING" else "control" if request in CONTROL else "data"
        rows.append((request, where, "yes" if request in COLLECTIVE else "", reply))
    return _table(("request", "endpoint", "collective", "reply"), *rows)


def _messages() -> str:
    return "\n".join(_message(cls) for cls in MESSAGES.values())


def _message(cls: type[Message]) -> str:
    schema, meanings = schema_of(cls), _meanings(cls)
    title = f"#### {schema.kind}\n\n{' '.join(inspect.getdoc(cls).split(chr(10) * 2)[0].split())}\n"
    listed_before = ADDRESS if issubclass(cls, SessionMessage) and cls is not Join else ()
    rows = [_field_row(spec, cls, meanings) for spec in schema.fields if spec.name not in listed_before]
    rows += [_array_row(spec, meanings) for spec in schema.arrays]
    return (
        f"{title}\n{_table(('field', 'type', 'default', 'meaning'), *rows)}"
        if rows
        else f"{title}\nNo {'further ' if listed_before else ''}fields.\n"
    )


def _field_row(spec: FieldSpec, cls: type[Message], meanings: dict[str, str]) -> tuple[str, ...]:
    kind = _kind(spec.kind) + "".join(_marker(marker) for marker in spec.markers)
    default = "required" if spec.required else _default(cls, spec.name)
    return f"`{spec.name}`", kind, default, meanings[spec.name]


def _array_row(spec: ArraySpec, meanings: dict[str, str]) -> tuple[str, ...]:
    kind = f"frames {'/'.join(spec.dtypes)} ({', '.join(spec.axes)})"
    return f"`{spec.name}`", kind, "required" if spec.required else "left out", meanings[spec.name]


def _kind(kind: Any) -> str:
    inner = get_args(kind)
    name = _KINDS[get_origin(kind) or kind]
    if name == "array" and inner and inner[0] is not Any:
        return f"array of {_kind(inner[0])}"
    if name == "map" and inner and inner[1] is not Any:
        return f"map of {_kind(inner[1])}"
    return name


def _marker(marker: Length | Choice | Range) -> str:
    if isinstance(marker, Choice):
        return ": " + ", ".join(f'`"{value}"`' for value in marker.values)
    if isinstance(marker, Range):
        return f" {marker.low} … {'2⁶³−1' if marker.high == 2**63 - 1 else marker.high}"
    return f", {marker.exactly} bytes" if marker.exactly is not None else f", ≤ {marker.at_most} bytes"


def _default(cls: type[Message], name: str) -> str:
    field = cls.__dataclass_fields__[name]
    value = field.default_factory() if callable(field.default_factory) else field.default
    if value is None:
        return "left out"
    return f"`{str(value).replace(chr(39), chr(34))}`" if not isinstance(value, str) else f'`"{value}"`'


def _meanings(cls: type[Message]) -> dict[str, str]:
    """Field → the comment after its declaration, of the class and its bases."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        lines = inspect.getsource(inspect.getmodule(base)).splitlines()
        _, first = inspect.getsourcelines(base)
        for node in ast.parse(inspect.getsource(base)).body[0].body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                found[node.target.id] = lines[first + node.end_lineno - 2][node.end_col_offset :].strip().lstrip("# ")
    return found


def _errors() -> str:
    rows = [
        (f"`{code.code}`", "yes" if code.retryable else "no", code.state, code.meaning) for code in ERROR_CODES.values()
    ]
    return _table(("code", "retryable", "state afterwards", "meaning"), *rows)


def _limits() -> str:
    rows = [
        (f"`{limit.name}`", str(limit.value), limit.unit, "protocol" if limit.fixed else "server", limit.meaning)
        for limit in LIMITS.values()
    ]
    return _table(("name", "value", "unit", "set by", "bounds"), *rows)


def _states() -> str:
    operations = [op for op in Operation if op is not Operation.LEASE_END]
    rows = []
    for state in State:
        cells = [TABLE[state][op] for op in (*operations, Operation.LEASE_END)]
        rows.append((state.value, *(cell.value if isinstance(cell, State) else "–" for cell in cells)))
    return _table(("state", *(op.value for op in operations), "lease ends"), *rows)


def _authorisation() -> str:
    """One row for each request; two columns for each role."""
    head = ["request"]
    for role in Role:
        head += [f"{role.value}: own", "another's"]
    rows = [(request, *(cell.value for role in Role for cell in MATRIX[role][request])) for request in REPLIES]
    return _table(tuple(head), *rows)


def _settings() -> str:
    rows = []
    for name, key in KEYS.items():
        default = "nil" if key.default is None else json.dumps(key.default)
        rows.append((f"`{name}`", _setting_type(key), f"`{default}`", key.meaning))
    return _table(("key", "type", "default", "meaning"), *rows)


def _setting_type(key: Key) -> str:
    """Type and choices or range, in the form that the conformance suite reads."""
    if key.choices:
        return (
            "str: " + ", ".join(f'`"{choice}"`' for choice in key.choices) + (" or nil" if key.default is None else "")
        )
    text = key.kind.__name__
    if key.high is not None:
        text += f" {key.low:.15g} … {key.high:.15g}"
    elif key.low is not None:
        text += f" ≥ {key.low:.15g}"
    text += "" if key.above is None else f" > {key.above:g}"
    return text.replace("-", "−") + (" or nil" if key.default is None else "")


if __name__ == "__main__":
    SPEC.write_text(rendered(SPEC.read_text(encoding="utf-8")), encoding="utf-8")
    # The conformance suite uses only the document, so it gets these tables from the document.
    subprocess.run([sys.executable, Path(__file__).parent / SPEC_TABLES, SPEC], check=True)

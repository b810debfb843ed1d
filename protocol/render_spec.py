"""Writes the tables of SPEC.md from the code: ``python protocol/render_spec.py``.

Between ``<!-- table: NAME -->`` and ``<!-- end -->`` SPEC.md holds what :func:`tables` renders; a test compares them.
The meaning of a field is the comment behind its declaration.
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

from mesh_motion_protocol.declarations import Choice, Length, Range
from mesh_motion_protocol.errors import ERROR_CODES
from mesh_motion_protocol.limits import LIMITS
from mesh_motion_protocol.messages import COLLECTIVE, CONTROL, MESSAGES, REPLIES, Join, Message, SessionMessage
from mesh_motion_protocol.schema import ArraySpec, FieldSpec, schema_of

from mesh_motion_server.numerics.interpolation.kernels import BASES
from mesh_motion_server.numerics.method import CHOICES
from mesh_motion_server.security.authorisation import MATRIX, Role
from mesh_motion_server.session.state import TABLE, Operation, State
from mesh_motion_server.settings import MethodSettings

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
    """SPEC.md's text with every table as the code has it."""
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
    return f"`{str(value).replace(chr(39), chr(34))}`" if not isinstance(value, str) else f'`"{value}"`'


def _meanings(cls: type[Message]) -> dict[str, str]:
    """Field → the comment behind its declaration, of the class and its bases."""
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
    """One row a request; two columns a role."""
    head = ["request"]
    for role in Role:
        head += [f"{role.value}: own", "another's"]
    rows = [(request, *(cell.value for role in Role for cell in MATRIX[role][request])) for request in REPLIES]
    return _table(tuple(head), *rows)


_SETTINGS = {
    "basis": ("str", "the radial basis function, by name"),
    "support_radius": ("float > 0 or nil", "R, mesh length unit; nil: chosen"),
    "support_radius_choice": ("str", "what a radius that is nil is chosen from: the mesh, once, or each motion"),
    "polynomial": ("str", "the linear polynomial beside the basis functions; `auto`: where the basis demands it"),
    "displacement": (
        "str",
        "what is interpolated: since the committed state, since the reference, or that in sub-steps",
    ),
    "correction": ("str", "how a motion below the threshold is corrected"),
    "correction_target": ("str", "where a correction stops"),
    "correction_in_time": (
        "str",
        "each motion is corrected on its own, or smoothly: no node jumps between steps; needs `optimised` and a "
        "displacement from the reference",
    ),
    "sub_steps": (
        "str",
        "lead the mesh to its targets in several corrected legs: where the motion would be refused, never, or always",
    ),
    "enrichment_radius": ("float > 0 or nil", "R_l, mesh length unit; nil: chosen from the mesh"),
    "quality_metric": ("str", "what the threshold is compared with"),
    "quality_threshold": ("float −1 … 1", "a motion predicted below it is corrected"),
    "max_enrichment_points": ("int 0 … 100000", "bound of the enrichment"),
    "enrichment_function": ("str", "the function at an enrichment point; `auto`: the correction's own"),
    "enrichment_placement": (
        "str",
        "where enrichment points go; `auto`: the correction's own way, and the only one of some corrections",
    ),
    "explicit_decomposition": ("str", "what `explicit` (above 1D `imposed-gradient` too) corrects a cell by"),
    "reduction": (
        "str",
        "how few boundary nodes are chosen to interpolate from; all are met exactly whatever is chosen",
    ),
    "reduction_tolerance": (
        "float 0 … 1",
        "largest error of a boundary node before it is made exact, as a share of the largest displacement",
    ),
    "max_control_points": ("int 0 … 1000000", "most boundary nodes that a reduction may choose; 0: no bound"),
    "volume_reduction": ("str", "at which places the interpolation is evaluated"),
    "volume_reduction_length": (
        "float > 0 or nil",
        "the box's margin, the wall function's distance or the grid's spacing, mesh length unit; nil: chosen",
    ),
    "boundary_layer_thickness": (
        "float > 0 or nil",
        "nodes this near to a moving wall move with it, mesh length unit; nil: none",
    ),
    "refuse_below_threshold": (
        "bool",
        "refuse a valid motion below the threshold; else it is answered with a warning",
    ),
    "allow_invalid": ("bool", "answer a motion that inverts cells instead of refusing it"),
    "predictor": ("str", "how the quality of the plain interpolation is predicted"),
    "quality_report": (
        "str",
        "which summaries have distributions: of every MOVED, or of a step's first one and of COMMITTED",
    ),
    "solver": ("str", "how the interpolation system is solved"),
}


def _settings() -> str:
    rows = []
    for name, field in MethodSettings.model_fields.items():
        kind, meaning = _SETTINGS[name]
        if name in CHOICES:
            kind += ": " + ", ".join(f'`"{choice}"`' for choice in CHOICES[name])
        elif name == "basis":
            kind += ": " + ", ".join(f'`"{choice}"`' for choice in BASES)
        default = "nil" if field.default is None else json.dumps(field.default)
        rows.append((f"`{name}`", kind, f"`{default}`", meaning))
    return _table(("key", "type", "default", "meaning"), *rows)


if __name__ == "__main__":
    SPEC.write_text(rendered(SPEC.read_text(encoding="utf-8")), encoding="utf-8")
    # The conformance suite knows nothing but the document, so it gets these tables from there.
    subprocess.run([sys.executable, Path(__file__).parent / SPEC_TABLES, SPEC], check=True)

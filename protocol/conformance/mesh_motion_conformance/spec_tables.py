"""SPEC.md's tables as values: ``python -m mesh_motion_conformance.spec_tables SPEC.md`` writes ``tables.json``.

The cases are made from the document, not from the declarations of an implementation.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

__all__ = ["TABLES", "read_spec", "rendered"]

#: In the folder of this module, so that an installed suite needs no document.
TABLES = Path(__file__).with_name("tables.json")

#: Requests of a session after JOIN.
_ADDRESSED = (
    "UPLOAD", "BUILD", "MOVE", "TANGENT", "COTANGENT", "JUDGE", "CORRECT", "COMMIT", "ROLLBACK", "FETCH", "STATUS",
    "CLOSE",
)  # fmt: skip
_BLOCK = re.compile(r"<!-- table: (\S+) -->\n(.*?)<!-- end -->", re.DOTALL)
_RANGE = re.compile(r"(-?[\d.]+|−[\d.]+) … (\S+)")


def read_spec(text: str) -> dict[str, Any]:
    """All marked tables of the document."""
    blocks = {match[1]: match[2] for match in _BLOCK.finditer(text)}
    return {
        "requests": {row["request"]: _request(row) for row in _rows(blocks["requests"])},
        "messages": dict(_messages(blocks["messages"])),
        "states": {row.pop("state"): _cells(row) for row in _rows(blocks["states"])},
        "limits": {_code(row["name"]): _limit(row) for row in _rows(blocks["limits"])},
        "settings": {_code(row["key"]): _setting(row) for row in _rows(blocks["settings"])},
        "errors": {_code(row["code"]): _error(row) for row in _rows(blocks["errors"])},
    }


def rendered(tables: dict[str, Any]) -> str:
    """The file's text."""
    return json.dumps(tables, indent=1, ensure_ascii=False) + "\n"


def _rows(block: str) -> list[dict[str, str]]:
    """A table's rows, by the names of its columns."""
    lines = [line.strip() for line in block.strip().splitlines() if line.strip().startswith("|")]
    table = [[cell.replace("\\|", "|").strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return [dict(zip(table[0], row, strict=True)) for row in table[2:]]


def _request(row: dict[str, str]) -> dict[str, Any]:
    return {"endpoint": row["endpoint"], "collective": row["collective"] == "yes", "reply": row["reply"]}


def _cells(row: dict[str, str]) -> dict[str, str | None]:
    return {operation: None if cell == "–" else cell for operation, cell in row.items()}


def _limit(row: dict[str, str]) -> dict[str, Any]:
    return {"value": int(row["value"]), "unit": row["unit"], "protocol": row["set by"] == "protocol"}


def _error(row: dict[str, str]) -> dict[str, Any]:
    return {"retryable": row["retryable"] == "yes", "state": row["state afterwards"]}


def _setting(row: dict[str, str]) -> dict[str, Any]:
    kind, or_nil, _ = row["type"].partition(" or nil")
    default = _code(row["default"])
    return _typed(kind) | {"nil": bool(or_nil), "default": None if default == "nil" else json.loads(default)}


def _messages(block: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Each message with its fields; requests after JOIN also have JOIN's address fields, which are listed only once."""
    address: list[dict[str, Any]] = []
    for part in block.split("#### ")[1:]:
        name, _, body = part.partition("\n")
        name = name.strip()
        rows = _rows(body) if "| field |" in body else []
        fields = [_field(row) for row in rows]
        if name == "JOIN":
            address = [field for field in fields if field["name"] != "token"]
        yield name, [*address, *fields] if name in _ADDRESSED else fields


def _field(row: dict[str, str]) -> dict[str, Any]:
    """One field: name, kind, limits of its value, and whether a sender may omit it."""
    field = {"name": _code(row["field"]), "required": row["default"] == "required"} | _typed(row["type"])
    if row["default"] not in ("required", "left out"):
        field["default"] = json.loads(_code(row["default"]).replace("False", "false").replace("True", "true"))
    return field


def _typed(text: str) -> dict[str, Any]:
    """A cell of a column ``type``: the kind, and the text after it."""
    if text.startswith("frames "):
        _, dtypes, axes = text.split(" ", 2)
        return {"kind": "frames", "dtypes": dtypes.split("/"), "axes": axes.strip("()").split(", ")}
    kind, *item = re.match(r"\w+(?: of .*)?", text)[0].split(" of ", 1)  # type: ignore[index]
    found: dict[str, Any] = {"kind": kind}
    if item:
        found["item"] = item[0]
    if choices := re.findall(r'`"([^`]*)"`', text):
        found["choices"] = choices
    if bounds := _RANGE.search(text):
        found |= {"low": _number(bounds[1]), "high": _number(bounds[2])}
    if "> 0" in text:
        found["above"] = 0
    if size := re.search(r"(≤ )?(\d+) bytes", text):
        found["at_most" if size[1] else "exactly"] = int(size[2])
    return found


def _number(text: str) -> int | float:
    text = text.replace("−", "-").rstrip(",")
    if text == "2⁶³-1":
        return 2**63 - 1
    return float(text) if "." in text else int(text)


def _code(text: str) -> str:
    return text.strip("`")


if __name__ == "__main__":
    TABLES.write_text(rendered(read_spec(Path(sys.argv[1]).read_text(encoding="utf-8"))), encoding="utf-8")

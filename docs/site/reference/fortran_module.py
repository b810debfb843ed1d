"""The Fortran module's procedures, from its source."""

from __future__ import annotations

import re
from pathlib import Path

from docs.site.reference.tables import code, table

__all__ = ["fortran_module"]

MODULE = Path(__file__).resolve().parents[3] / "adapters" / "c" / "fortran" / "mesh_motion.f90"
_BINDING = re.compile(r"^      (?:procedure|generic) :: (\w+) => (.+)$", re.MULTILINE)
_TYPE = re.compile(r"^   type :: (mm_\w+)\n(.*?)^   end type", re.MULTILINE | re.DOTALL)


def fortran_module() -> str:
    """A table of each type's procedures: arguments and meaning."""
    text = MODULE.read_text(encoding="utf-8")
    return "\n".join(f"## type({name})\n\n{_procedures(text, body)}" for name, body in _TYPE.findall(text))


def _procedures(text: str, body: str) -> str:
    """The bindings of a type."""
    rows = []
    for name, targets in _BINDING.findall(body):
        for target in targets.split(", "):
            call, arguments, comment = _procedure(text, target)
            rows.append((code(f"{call}{name}({arguments})"), comment))
    return table(("procedure", ""), _together(rows))


def _together(rows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Variants with the same call are shown once, with the comment of the first."""
    first: dict[str, str] = {}
    for call, comment in rows:
        first.setdefault(call, comment)
    return list(first.items())


def _procedure(text: str, name: str) -> tuple[str, str, str]:
    """Kind of a procedure, its arguments without the object itself, and the comment above or after it."""
    found = re.search(rf"((?:^   !.*\n)*)^   (?:\w+ )*?(function|subroutine) {name}\(([^)]*)\)", text, re.MULTILINE)
    if found is None:
        return "", "", ""
    comment = " ".join(line.strip(" !") for line in found[1].splitlines() if "---" not in line)
    arguments = ", ".join(part.strip() for part in found[3].replace("&\n", "").split(",")[1:])
    return ("call " if found[2] == "subroutine" else ""), arguments, comment

"""The C client's calls, from the comments of its header."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["c_header"]

HEADER = Path(__file__).resolve().parents[3] / "adapters" / "c" / "include" / "mesh_motion.h"
_SECTION = re.compile(r"^/\* --- (.+?) -+ \*/$", re.MULTILINE)


def c_header() -> str:
    """The header's sections: each comment, then the declarations below it."""
    text = HEADER.read_text(encoding="utf-8")
    name, *parts = _SECTION.split(text.partition("#define MM_VERSION")[2].partition("#ifdef __cplusplus")[0])
    sections = [("Types and results", name.partition("\n")[2]), *zip(parts[::2], parts[1::2], strict=True)]
    return "\n".join(f"## {title[0].upper()}{title[1:]}\n\n{_section(body)}" for title, body in sections)


def _section(body: str) -> str:
    """Groups of declarations, each below its comment."""
    return "\n".join(_group(comment, code) for comment, code in _groups(body.strip("\n").splitlines()))


def _groups(lines: list[str]) -> list[tuple[str, str]]:
    """(comment, declarations): a new group begins with a comment at the margin, or after an empty line."""
    groups: list[tuple[list[str], list[str]]] = [([], [])]
    inside = False
    for line in lines:
        if line.startswith("/*") or (not line.strip() and groups[-1][1]):
            groups.append(([], []))
        inside = inside or line.startswith("/*")
        groups[-1][0 if inside else 1].append(line)
        inside = inside and "*/" not in line
    joined = [("\n".join(comment), "\n".join(code).strip("\n")) for comment, code in groups]
    return [(comment, code) for comment, code in joined if comment or code]


def _group(comment: str, code: str) -> str:
    words = re.sub(r"^/\*|\*/$|^ \*(?: |$)", "", comment.strip(), flags=re.MULTILINE)
    shown = code.replace("MM_API ", "")
    text = " ".join(words.split())
    return (f"{text}\n\n" if text else "") + (f"```c\n{shown}\n```\n" if shown else "")

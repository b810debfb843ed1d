"""Manual pages from the command line itself: ``docs/man/mesh-motion.1`` and one for each command.

``make manual`` writes them, a test fails when they differ from the commands, and the wheel installs them
in ``share/man/man1``.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.main import get_command

from mesh_motion_server.commands.app import app
from mesh_motion_server.commands.outcome import __doc__ as statuses

__all__ = ["FOLDER", "examples", "pages"]

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "man"

_ENVIRONMENT = (
    ("MESH_MOTION_KEY", "A client's .secret file, where --key is not given."),
    ("MESH_MOTION_SERVER_KEY", "The server's .public file, or the key itself, where --server-key is not given."),
)
_FILES = (("~/.local/state/mesh-motion", "Where a server stores its sessions, if --state does not say otherwise."),)


def commands() -> dict[str, Any]:
    """Every command by its full name, ``play``, ``keys allow``, …, in alphabetical order of the first word."""
    found: dict[str, Any] = {}
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined]
        inner = getattr(command, "commands", {})
        found |= {f"{name} {part}": inner[part] for part in inner} or {name: command}
    return {name: found[name] for name in sorted(found, key=lambda name: name.partition(" ")[0])}


def examples(help_text: str) -> list[str]:
    """The example command lines at the end of a command's help."""
    return [line.strip() for line in inspect.cleandoc(help_text).splitlines() if line.startswith("mesh-motion ")]


def pages() -> dict[str, str]:
    """File name → text of every page."""
    made = {"mesh-motion.1": _overview()}
    groups: dict[str, list[tuple[str, Any]]] = {}
    for name, command in commands().items():
        groups.setdefault(name.partition(" ")[0], []).append((name, command))
    for group, members in groups.items():
        made[f"mesh-motion-{group}.1"] = "\n".join(_page(group, members)) + "\n"
    return made


def _overview() -> str:
    """The page of the program."""
    about = get_command(app)
    lines = [_title("mesh-motion"), ".SH NAME", f"mesh\\-motion \\- {_roff(_first_sentence(about.help))}"]
    lines += [".SH SYNOPSIS", ".B mesh\\-motion", ".I COMMAND", "[\\fIOPTION\\fR ...]", ".SH COMMANDS"]
    for name, command in commands().items():
        lines += _item(f"\\fBmesh\\-motion {_roff(name)}\\fR", _first_sentence(command.help))
    lines += [".SH OPTIONS"]
    lines += _options(about.params)
    lines += [".SH EXIT STATUS"]
    for status, meaning in re.findall(r"^(\d+)\s+(.+)$", str(statuses), re.MULTILINE):
        lines += _item(f"\\fB{status}\\fR", meaning.replace("`", ""))
    lines += [".SH ENVIRONMENT", *(line for name, text in _ENVIRONMENT for line in _item(f"\\fB{name}\\fR", text))]
    lines += [".SH FILES", *(line for name, text in _FILES for line in _item(f"\\fI{_roff(name)}\\fR", text))]
    groups = sorted({name.partition(" ")[0] for name in commands()})
    lines += [".SH SEE ALSO", ", ".join(f"\\fBmesh\\-motion\\-{name}\\fR(1)" for name in groups)]
    return "\n".join(lines) + "\n"


def _page(group: str, members: list[tuple[str, Any]]) -> Iterator[str]:
    """Lines of the page of a command, or of a command with subcommands."""
    yield _title(f"mesh-motion-{group}")
    yield ".SH NAME"
    yield f"mesh\\-motion\\-{group} \\- {_roff(' '.join(command.short_help for _, command in members).rstrip('.'))}"
    yield ".SH SYNOPSIS"
    for name, command in members:
        yield f".B mesh\\-motion {_roff(name)}"
        arguments = [_metavar(p) for p in command.params if p.param_type_name == "argument"]
        yield " ".join(f"\\fI{_roff(metavar)}\\fR" for metavar in arguments) or "\\&"
        yield "[\\fIOPTION\\fR ...]\n.br"
    for name, command in members:
        yield f".SH {'DESCRIPTION' if len(members) == 1 else _roff(name).upper()}"
        yield from _description(command.help)
        yield from _options(command.params)
    shown = [line for _, command in members for line in examples(command.help)]
    if shown:
        yield ".SH EXAMPLES\n.nf"
        yield from map(_roff, shown)
        yield ".fi"
    yield ".SH SEE ALSO\n\\fBmesh\\-motion\\fR(1)"


def _title(name: str) -> str:
    return f'.TH "{_roff(name).upper()}" 1 "" "mesh\\-motion\\-server" "User commands"'


def _first_sentence(text: str | None) -> str:
    return inspect.cleandoc(text or "").partition("\n\n")[0].replace("\n", " ")


def _description(text: str) -> Iterator[str]:
    """The paragraphs of a help text before its examples."""
    prose = inspect.cleandoc(text).partition("\b")[0].strip()
    for paragraph in prose.split("\n\n"):
        yield f".PP\n{_roff(' '.join(paragraph.split()))}"


def _options(parameters: list[Any]) -> Iterator[str]:
    """The meaning of each argument and option."""
    for parameter in parameters:
        text = parameter.help or ""
        if parameter.default not in (None, False, "", ...) and parameter.show_default:
            text += f" Default: {getattr(parameter.default, 'value', parameter.default)}."
        yield from _item(_label(parameter), text)


def _label(parameter: Any) -> str:
    """``-o, --out DIR``."""
    if parameter.param_type_name == "argument":
        return f"\\fI{_roff(_metavar(parameter))}\\fR"
    names = ", ".join(f"\\fB{_roff(name)}\\fR" for name in (*parameter.opts, *parameter.secondary_opts))
    return names if parameter.is_flag else f"{names} \\fI{_roff(_metavar(parameter))}\\fR"


def _metavar(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name.upper())


def _item(label: str, text: str) -> list[str]:
    return [".TP", label, _roff(text)]


def _roff(text: str) -> str:
    """Plain text for roff: no line of it may begin a request, and a hyphen stays one."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{escaped}" if escaped.startswith((".", "'")) else escaped


def main() -> None:
    """Write the pages, and remove pages of removed commands."""
    FOLDER.mkdir(exist_ok=True)
    made = pages()
    for page in FOLDER.glob("*.1"):
        if page.name not in made:
            page.unlink()
    for name, text in made.items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

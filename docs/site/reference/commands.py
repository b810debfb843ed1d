"""The command line, from the commands themselves."""

from __future__ import annotations

import re
from typing import Any

import typer

from docs.site.reference.tables import code, table

__all__ = ["commands"]

PROGRAM = "mesh-motion"


def commands() -> str:
    """Every command with its description, its arguments and its options."""
    from mesh_motion_server.commands.app import app  # noqa: PLC0415 it imports the whole command line

    group = typer.main.get_command(app)
    parts = [_command(f"{PROGRAM} {name}", command) for name, command in sorted(_leaves(group))]
    return "\n".join([f"{_one_line(group.epilog)}\n", *parts])


def _leaves(group: Any, before: str = "") -> list[tuple[str, Any]]:
    """(name, command) of a group and of its subgroups."""
    found: list[tuple[str, Any]] = []
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            found += _leaves(command, f"{before}{name} ")
        elif not command.hidden:
            found.append((f"{before}{name}", command))
    return found


def _command(title: str, command: Any) -> str:
    """A command: description, examples, a table of its arguments and options."""
    rows = [row for parameter in command.params if (row := _parameter(parameter)) is not None]
    given = table(("takes", "default", ""), rows) if rows else ""
    return f"## {title}\n\n{_text(command.help or '')}\n\n{given}"


def _text(help_text: str) -> str:
    """Help as Markdown: paragraphs marked for the terminal unchanged, the others as text."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", help_text.strip()):
        if paragraph.startswith("\b"):
            parts.append("```sh\n" + "\n".join(line.strip() for line in paragraph[1:].strip().splitlines()) + "\n```")
        else:
            parts.append(_one_line(paragraph))
    return "\n\n".join(parts)


def _parameter(parameter: Any) -> tuple[str, str, str] | None:
    """One argument or option; None for a hidden one."""
    if getattr(parameter, "hidden", False):
        return None
    if parameter.param_type_name == "argument":
        return code(parameter.metavar or parameter.name.upper()), "", _one_line(getattr(parameter, "help", "") or "")
    names = ", ".join(map(code, [*parameter.opts, *parameter.secondary_opts]))
    takes = "" if parameter.is_flag else f" {code(parameter.metavar or parameter.name.upper())}"
    default = parameter.default
    shown = "" if default is None or default is False or callable(default) or default == () else code(default)
    needed = "required" if parameter.required else shown
    return names + takes, needed, _one_line(parameter.help or "")


def _one_line(text: str | None) -> str:
    """Text without line ends."""
    return " ".join((text or "").split())

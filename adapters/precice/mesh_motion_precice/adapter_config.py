"""Read ``precice-adapter-config.json``, by preCICE's guidelines for adapters, into the tables of the TOML file.

The JSON file names the participant, preCICE's configuration and the interfaces. Its schema has no place for the mesh,
the roles of its patches and the method: they are in the TOML file that ``mesh-motion.case`` names. Schema:
github.com/precice/adapter-schema.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from mesh_motion_client import InvalidInput

__all__ = ["read_tables"]

#: An interface of the schema.
_KEYS = ("mesh_name", "patches", "location", "read_data", "write_data", "is_received")
#: ``solver_name`` of the written data, and the key of ``[write]`` that names the data.
_WRITTEN = {"displacement": "data", "velocity": "velocity"}


def read_tables(path: Path) -> tuple[dict[str, Any], Path]:
    """The tables of a participant's file, TOML or JSON, and the base folder of the file names in it.

    Raises
    ------
    InvalidInput
        A file cannot be read, or the JSON file does not fit the schema.
    """
    text = _text(path)
    if path.suffix != ".json":
        return _toml(path, text), path.parent
    try:
        values = json.loads(text)
        case = path.parent / _known(values["mesh-motion"], ("case",), "mesh-motion")["case"]
        tables = _toml(case, _text(case))
        if double := [name for name in ("precice", "read", "write") if name in tables]:
            raise InvalidInput(f"[{double[0]}] is in {case} and also in this file")
        return tables | _coupled(values, path.parent), case.parent
    except json.JSONDecodeError as error:
        raise InvalidInput(f"not a JSON file: {error}") from None
    except KeyError as error:
        raise InvalidInput(f"{error.args[0]} is missing") from None
    except TypeError as error:
        raise InvalidInput(f"a value does not have the type that the schema requires: {error}") from None


def _coupled(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """[precice], [[read]] and [write]."""
    _known(values, ("participant_name", "precice_config_file_path", "interfaces", "mesh-motion"), "the file")
    tables = [_interface(entry, f"interfaces[{number}]") for number, entry in enumerate(values["interfaces"], start=1)]
    written = [table for name, table in tables if name == "write"]
    if len(written) != 1:
        raise InvalidInput(f"one interface must have write_data, got {len(written)}")
    config = str((folder / values["precice_config_file_path"]).absolute())
    return {
        "precice": {"participant": values["participant_name"], "config": config},
        "read": [table for name, table in tables if name == "read"],
        "write": written[0],
    }


def _interface(entry: dict[str, Any], where: str) -> tuple[str, dict[str, Any]]:
    """The name and the content of an interface's table."""
    _known(entry, _KEYS, where)
    read, written, patches = entry.get("read_data", []), entry.get("write_data", []), entry.get("patches", [])
    if entry.get("location", "nodes") != "nodes":
        raise InvalidInput(f"{where}.location: expected nodes, got {entry['location']!r}")
    if bool(read) == bool(written):
        raise InvalidInput(f"{where}: expected read_data or write_data, and not both")
    if read:
        if (len(read), len(patches)) != (1, 1):
            raise InvalidInput(f"{where}: what is read needs one entry in read_data and one in patches")
        return "read", {"patch": patches[0], "mesh": entry["mesh_name"], "data": read[0]["name"]}
    if patches:
        raise InvalidInput(f"{where}.patches: what is written is written for all nodes of the mesh")
    data = {_written(item, where): item["name"] for item in written}
    return "write", {"mesh": entry["mesh_name"], "received": entry.get("is_received", False)} | data


def _written(item: dict[str, Any], where: str) -> str:
    """The key of [write] for an entry of write_data."""
    what = item.get("solver_name", "displacement")
    if what not in _WRITTEN:
        raise InvalidInput(f"{where}.write_data: expected solver_name {' or '.join(_WRITTEN)}, got {what!r}")
    return _WRITTEN[what]


def _known(values: dict[str, Any], keys: tuple[str, ...], where: str) -> dict[str, Any]:
    """The table's values, after a check for unknown keys."""
    if unknown := [key for key in values if key not in keys]:
        raise InvalidInput(f"unknown key {unknown[0]!r} in {where}; known are {', '.join(keys)}")
    return values


def _toml(path: Path, text: str) -> dict[str, Any]:
    """The tables of a TOML file."""
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InvalidInput(f"{path.name} is not a TOML file: {error}") from None


def _text(path: Path) -> str:
    """The content of the file."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidInput(f"{path.name} cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{path.name} is not a text file: {error}") from None

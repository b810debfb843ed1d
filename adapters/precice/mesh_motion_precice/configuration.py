"""Read the participant's file into a checked :class:`Configuration`.

``[mesh]``, ``[patches]`` and ``[method]`` are those of a case file; ``[precice]``, ``[[read]]``, ``[write]`` and
``[coupling]`` assign preCICE's meshes and data to them. Names of files are relative to the file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from mesh_motion_client import InvalidInput
from mesh_motion_client.mesh import ROLES

from mesh_motion_precice.adapter_config import read_tables

__all__ = ["Configuration", "Frame", "Surface", "Volume", "read_configuration"]

Frame = Literal["reference", "committed"]
Scheme = Literal["bdf1", "bdf2", "bossak"]
_Section = TypeVar("_Section")


@dataclass(frozen=True)
class Surface:
    """One ``[[read]]``: a moving patch, and the preCICE mesh that it provides.

    Attributes
    ----------
    patch : str
        A patch with the role moving.
    mesh : str
        The preCICE mesh; its vertices are the patch's nodes.
    data : str
        The displacement read there.
    """

    patch: str
    mesh: str
    data: str = "Displacement"


@dataclass(frozen=True)
class Volume:
    """``[write]``: the preCICE mesh that gets the displacement of the nodes.

    Attributes
    ----------
    received : bool
        False: the mesh is provided here, a vertex a node. True: the mesh belongs to a solver and is received from it
        with ``api-access="true"``; each of its vertices must lie on a node of the mesh file.
    velocity : str
        The data that gets the nodes' velocity; empty: it is not written.
    """

    mesh: str
    data: str = "NodeDisplacement"
    received: bool = False
    velocity: str = ""


@dataclass(frozen=True)
class _PreciceSection:
    config: str = "precice-config.xml"
    participant: str = "MeshMotion"


@dataclass(frozen=True)
class _MeshSection:
    file: str
    zone: str = ""


@dataclass(frozen=True)
class _CouplingSection:
    frame: Frame = "reference"
    time_step: float = float("inf")
    velocity_scheme: Scheme = "bdf1"


@dataclass(frozen=True)
class Configuration:
    """A checked file.

    Attributes
    ----------
    precice_config : Path
        preCICE's own configuration.
    participant : str
        The participant's name there.
    patches : dict of str to str
        The role of each patch.
    surfaces : tuple of Surface
        One a moving patch.
    frame : {"reference", "committed"}
        The state from which displacements count, those read and those written: the mesh file's coordinates, or the end
        of the last window.
    time_step : float
        Longest step, time unit; infinite: a window is one step.
    velocity_scheme : {"bdf1", "bdf2", "bossak"}
        The server's scheme of the nodes' velocity.
    method : dict
        Settings of the method, for the server to check.
    mesh_zone : str
        The zone of a mesh file that has several.
    """

    precice_config: Path
    participant: str
    mesh_file: Path
    patches: dict[str, str]
    surfaces: tuple[Surface, ...]
    volume: Volume
    frame: Frame = "reference"
    time_step: float = float("inf")
    velocity_scheme: Scheme = "bdf1"
    method: dict[str, Any] = field(default_factory=dict)
    mesh_zone: str = ""


def read_configuration(path: str | os.PathLike[str]) -> Configuration:
    """Read and check a participant's file, TOML or ``precice-adapter-config.json``.

    Raises
    ------
    InvalidInput
        The file cannot be read, or does not fit the format. The error has the first wrong key and what was expected.
    """
    path = Path(path)
    try:
        return _checked(*read_tables(path))
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error.message}", hint=error.hint) from None


def _checked(values: dict[str, Any], folder: Path) -> Configuration:
    """The configuration of the file's tables."""
    known = ("precice", "mesh", "patches", "read", "write", "coupling", "method")
    if unknown := [name for name in values if name not in known]:
        raise InvalidInput(f"unknown table {unknown[0]!r}; known are {', '.join(known)}")
    entries = values.get("read", [])
    if not isinstance(entries, list):
        raise InvalidInput("[read] must be a list of tables", hint="write [[read]] once for each moving patch")
    precice = _section(_PreciceSection, values.get("precice", {}), "precice")
    coupling = _section(_CouplingSection, values.get("coupling", {}), "coupling")
    for key, choices in (("frame", get_args(Frame)), ("velocity_scheme", get_args(Scheme))):
        if (value := getattr(coupling, key)) not in choices:
            raise InvalidInput(f"coupling.{key} must be one of {', '.join(choices)}, got {value!r}")
    if not coupling.time_step > 0.0:
        raise InvalidInput(f"coupling.time_step must be positive, got {coupling.time_step!r}")
    if coupling.velocity_scheme != "bdf1" and coupling.time_step < float("inf"):
        raise InvalidInput(
            f"coupling.time_step: with velocity_scheme = {coupling.velocity_scheme!r} a window must be one step, "
            f"got {coupling.time_step!r}",
            hint="leave coupling.time_step away, or use velocity_scheme = 'bdf1'",
        )
    mesh = _section(_MeshSection, values.get("mesh", {}), "mesh")
    configuration = Configuration(
        precice_config=folder / precice.config,
        participant=precice.participant,
        mesh_file=folder / mesh.file,
        patches=_table(values.get("patches", {}), "patches"),
        surfaces=tuple(_section(Surface, entry, f"read[{number}]") for number, entry in enumerate(entries, start=1)),
        volume=_section(Volume, values.get("write", {}), "write"),
        frame=coupling.frame,
        time_step=coupling.time_step,
        velocity_scheme=coupling.velocity_scheme,
        method=_table(values.get("method", {}), "method"),
        mesh_zone=mesh.zone,
    )
    _check_patches(configuration)
    return configuration


def _table(values: Any, name: str) -> dict[str, Any]:
    """The values of a table."""
    if not isinstance(values, dict):
        raise InvalidInput(f"{name} must be a table, got {values!r}")
    return values


def _section(kind: type[_Section], values: Any, name: str) -> _Section:
    """Convert a table to its dataclass: no unknown key, no missing key, types as declared."""
    table: Mapping[str, Any] = _table(values, name)
    declared = {entry.name: entry for entry in fields(kind)}  # type: ignore[arg-type]
    if unknown := [key for key in table if key not in declared]:
        raise InvalidInput(f"unknown key {name}.{unknown[0]}; known are {', '.join(declared)}")
    for key, entry in declared.items():
        if key not in table:
            if entry.default is MISSING:
                raise InvalidInput(f"{name}.{key} is missing")
            continue
        expected: Any = {"bool": bool, "float": (int, float)}.get(str(entry.type), str)
        is_flag = isinstance(table[key], bool)  # True is an int to Python
        if not isinstance(table[key], expected) or is_flag != (expected is bool) or table[key] == "":
            raise InvalidInput(f"{name}.{key}: expected {_WORDS[expected]}, got {table[key]!r}")
    return kind(**table)


_WORDS: dict[Any, str] = {bool: "true or false", str: "a name", (int, float): "a number"}


def _check_patches(configuration: Configuration) -> None:
    """Check that roles are known, that each moving patch is read once, and that each mesh has one purpose."""
    roles = configuration.patches
    for name, role in roles.items():
        if role not in ROLES:
            raise InvalidInput(f"patches.{name}: expected one of {', '.join(ROLES)}, got {role!r}")
    moving = [name for name, role in roles.items() if role == "moving"]
    read = [surface.patch for surface in configuration.surfaces]
    for number, patch in enumerate(read, start=1):
        if patch not in moving:
            raise InvalidInput(f"read[{number}]: patch {patch!r} is none of the moving ones: {', '.join(moving)}")
        if patch in read[: number - 1]:
            raise InvalidInput(f"read[{number}]: patch {patch!r} is read already")
    if missing := [patch for patch in moving if patch not in read]:
        raise InvalidInput(
            f"the moving patch {missing[0]!r} has no [[read]]", hint='give it one, or the role "fixed" in [patches]'
        )
    if not moving:
        raise InvalidInput("no patch has the role moving", hint='for example  [patches]  flap = "moving"')
    meshes = [surface.mesh for surface in configuration.surfaces] + [configuration.volume.mesh]
    if twice := [mesh for mesh in meshes if meshes.count(mesh) > 1]:
        raise InvalidInput(
            f"the preCICE mesh {twice[0]!r} is named twice", hint="each [[read]] and [write] has its own"
        )

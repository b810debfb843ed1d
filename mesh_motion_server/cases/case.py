"""The case file: TOML becomes a checked :class:`Case`, or an error with the file, the key and the expected value.

All lengths are in the mesh's unit, angles in degrees. Every patch of the mesh needs a role; a free one is left out.
"""

import math
import stat
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from mesh_motion_protocol.errors import InvalidInput, meant
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from mesh_motion_server.files import MeshFile, read_mesh
from mesh_motion_server.settings import MethodSettings
from mesh_motion_server.toml import read_toml

Role = Literal["moving", "fixed", "slip", "symmetry", "periodic", "free"]
Vector = Annotated[list[float], Field(min_length=1, max_length=3)]


class _Section(BaseModel):
    """A table of the case file: strict types, no unknown keys, no NaN."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class MeshSection(_Section):
    """``[mesh]``."""

    file: Annotated[str, Field(min_length=1)]
    zone: str = ""


class RigidMotion(_Section):
    """``rigid``: the rotation about ``centre`` (and ``axis``, in 3D) first, then the translation.

    Step s of S applies s/S of the angle and s/S of the translation.
    """

    translation: Vector | None = None
    rotation: float = 0.0
    centre: Vector | None = None
    axis: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if self.rotation and self.centre is None:
            raise ValueError("a rotation needs 'centre'")
        if self.axis is not None and not any(self.axis):
            raise ValueError("'axis' must not be zero")
        if self.translation is None and not self.rotation:
            raise ValueError("give 'translation', 'rotation' or both")
        return self


class Oscillation(_Section):
    """``oscillation``: along ``direction``, or about ``centre`` (and ``axis``, in 3D).

    After step s the amplitude is multiplied by sin(2π frequency s + phase) − sin(phase): so a case begins at rest.
    """

    amplitude: float
    frequency: Annotated[float, Field(gt=0)]
    phase: float = 0.0
    direction: Vector | None = None
    centre: Vector | None = None
    axis: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if not self.amplitude:
            raise ValueError("'amplitude' must not be zero")
        if (self.direction is None) == (self.centre is None):
            raise ValueError("give either 'direction' or 'centre'")
        for name in ("direction", "axis"):
            vector = getattr(self, name)
            if vector is not None and not any(vector):
                raise ValueError(f"'{name}' must not be zero")
        return self

    @property
    def rigid(self) -> RigidMotion:
        """The motion of one amplitude."""
        if self.direction is None:
            return RigidMotion(rotation=self.amplitude, centre=self.centre, axis=self.axis)
        length = math.hypot(*self.direction)
        return RigidMotion(translation=[self.amplitude * entry / length for entry in self.direction])


class Bending(_Section):
    """``bending``: a body from ``clamp`` to ``tip`` bends about ``axis`` (in 3D); its end at ``clamp`` does not move.

    The other end turns by ``rotation``. With ``both_ends`` it does not move either, and ``rotation`` is the largest
    slope between the ends.
    """

    rotation: float
    clamp: Vector
    tip: Vector
    axis: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    both_ends: bool = False

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if not self.rotation:
            raise ValueError("'rotation' must not be zero")
        if self.both_ends and abs(self.rotation) >= 90:
            raise ValueError("with 'both_ends' the slope 'rotation' must lie between -90 and 90 degrees")
        if self.clamp == self.tip:
            raise ValueError("'clamp' and 'tip' must be two places")
        if self.axis is not None and not any(self.axis):
            raise ValueError("'axis' must not be zero")
        return self


class MotionSection(_Section):
    """One ``[[motion]]``: the total motion of one patch over the whole case."""

    patch: str
    rigid: RigidMotion | None = None
    oscillation: Oscillation | None = None
    bending: Bending | None = None
    table: str | None = None

    @model_validator(mode="after")
    def _has_one_kind(self) -> Self:
        kinds = ("rigid", "oscillation", "bending", "table")
        if sum(getattr(self, kind) is not None for kind in kinds) != 1:
            raise ValueError("give exactly one of 'rigid', 'oscillation', 'bending' and 'table'")
        return self


class StepsSection(_Section):
    """``[steps]``."""

    count: Annotated[int, Field(ge=1, le=1_000_000)]
    iterations: Annotated[int, Field(ge=1, le=1000)] = 1


class CaseFile(_Section):
    """The whole file."""

    mesh: MeshSection
    patches: Annotated[dict[str, Role], Field(min_length=1)]
    motion: Annotated[list[MotionSection], Field(min_length=1)]
    steps: StepsSection
    method: MethodSettings = MethodSettings()


@dataclass(frozen=True)
class Case:
    """A checked case file and its path."""

    path: Path
    content: CaseFile

    @property
    def name(self) -> str:
        """The name of the case, see :func:`case_name`."""
        return case_name(self.path)

    @property
    def mesh_path(self) -> Path:
        """The mesh file; a relative name is relative to the case file."""
        return self.path.parent / self.content.mesh.file

    @property
    def roles(self) -> dict[str, Role]:
        """The role of each patch that :meth:`fitting` leaves in the mesh."""
        return {name: role for name, role in self.content.patches.items() if role != "free"}

    def read_mesh(self) -> MeshFile:
        """Read the mesh and return it as :meth:`fitting` does.

        Raises InvalidInput as :func:`~mesh_motion_server.files.read_mesh` and :meth:`fitting`.
        """
        return self.fitting(read_mesh(self.mesh_path, self.content.mesh.zone))

    def fitting(self, mesh: MeshFile) -> MeshFile:
        """The mesh without its free patches; it is checked that it matches the case.

        Raises InvalidInput for a patch without a role, a role for no patch, a motion of a patch that does not move, and
        one whose vectors do not have the mesh's dimension.
        """
        roles = self.content.patches
        missing = [name for name in mesh.patches if name not in roles]
        unknown = [name for name in roles if name not in mesh.patches]
        if unknown and (not missing or meant(unknown[0], missing)):
            known = ", ".join(map(repr, mesh.patches)) or "none"
            raise InvalidInput(
                f"{self.path}: {mesh.path.name} has no patch {unknown[0]!r}; its patches are {known}",
                hint=meant(unknown[0], missing or mesh.patches),
            )
        if missing:
            raise InvalidInput(
                f"{self.path}: patch {missing[0]!r} of {mesh.path.name} has no role",
                hint=f'add  {toml_key(missing[0])} = "fixed"  to [patches]; roles are {", ".join(get_args(Role))}',
            )
        if empty := [name for name, nodes in mesh.patches.items() if not len(nodes)]:
            raise InvalidInput(f"{self.path}: patch {empty[0]!r} of {mesh.path.name} has no nodes")
        _check_motions(self.path, self.content)
        for number, motion in enumerate(self.content.motion, start=1):
            _check_vectors(self.path, number, motion.rigid or motion.oscillation or motion.bending, mesh.dimension)
        return replace(mesh, patches={name: mesh.patches[name] for name in mesh.patches if name in self.roles})


def case_name(path: Path) -> str:
    """The folder's name for ``case.toml``; the file's name for any other file."""
    return path.resolve().parent.name if path.stem == "case" else path.stem


def read_case(path: Path | str) -> Case:
    """Read and check a case file.

    Raises InvalidInput if the file is unreadable, no TOML or does not fit the format; names the first wrong key and
    what is expected.
    """
    path = Path(path)
    try:
        if not (stat.S_ISREG(mode := path.stat().st_mode) or stat.S_ISDIR(mode)):
            raise OSError("it is a pipe or a device, expected a file")
        values = read_toml(path.read_text(encoding="utf-8"))
        content = CaseFile.model_validate(values)
    except OSError as error:
        raise InvalidInput(f"{path}: the case file cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: not a TOML file: {str(error).splitlines()[0]}") from None
    except ValidationError as error:
        raise _first_offender(error, path) from None
    except InvalidInput as error:  # keys of [method] that cannot be combined
        raise InvalidInput(f"{path}: method.{error.message}", hint=error.hint, details=error.details) from None
    return Case(path, content)


def _check_motions(path: Path, content: CaseFile) -> None:
    """Check that each motion belongs to a patch with the role moving."""
    for number, motion in enumerate(content.motion, start=1):
        role = content.patches.get(motion.patch)
        if role is None:
            known = ", ".join(map(repr, content.patches))
            raise InvalidInput(
                f"{path}: motion {number}: unknown patch {motion.patch!r}; [patches] has {known}",
                hint=meant(motion.patch, content.patches),
            )
        if role != "moving":
            raise InvalidInput(
                f"{path}: motion {number}: patch {motion.patch!r} has the role {role!r}; only moving patches move"
            )


def _check_vectors(path: Path, number: int, motion: RigidMotion | Oscillation | Bending | None, dimension: int) -> None:
    """Check that the vectors of a motion have the mesh's dimension."""
    if motion is None:
        return
    for name in ("translation", "direction", "centre", "clamp", "tip"):
        vector = getattr(motion, name, None)
        if vector is not None and len(vector) != dimension:
            raise InvalidInput(
                f"{path}: motion {number}: {name} has {len(vector)} entries, but the mesh is {dimension}D"
            )
    rigid = motion.rigid if isinstance(motion, Oscillation) else motion
    if rigid.rotation and dimension == 1:
        raise InvalidInput(f"{path}: motion {number}: a 1D mesh has no rotation")
    if rigid.rotation and dimension == 3 and rigid.axis is None:
        raise InvalidInput(f"{path}: motion {number}: a rotation in 3D needs 'axis', for example [0, 0, 1]")
    if isinstance(motion, Bending) and dimension == 3:
        _check_bending_axis(path, number, motion)
    if dimension == 2 and rigid.axis is not None and any(rigid.axis[:2]):
        raise InvalidInput(f"{path}: motion {number}: in 2D the only axis is [0, 0, 1], got {rigid.axis}")


def _check_bending_axis(path: Path, number: int, motion: Bending) -> None:
    """Check that a body in 3D does not lie along the axis about which it bends."""
    along = [tip - clamp for tip, clamp in zip(motion.tip, motion.clamp, strict=True)]
    axis = motion.axis or []
    within = abs(sum(a * b for a, b in zip(along, axis, strict=True)))
    if within > (1 - 1e-9) * math.hypot(*along) * math.hypot(*axis):
        raise InvalidInput(
            f"{path}: motion {number}: a body along {along} cannot bend about {axis}",
            hint="'axis' must be perpendicular to the line from 'clamp' to 'tip'",
        )


#: Examples of values for missing keys.
_WAYS_OUT = {
    "mesh": 'add [mesh] with file = "mesh.msh"',
    "mesh.file": 'add to [mesh] file = "mesh.msh"',
    "patches": 'add [patches] with the role of each, such as wall = "moving"',
    "motion": 'add [[motion]] with patch = "wall" and rigid = { translation = [0.0, 0.1] }',
    "steps": "add [steps] with count = 1",
    "steps.count": "add to [steps] count = 1",
}


def _first_offender(error: ValidationError, path: Path) -> InvalidInput:
    """One line for the first error: file, key, value, expectation. A misspelt key comes before a missing one."""
    first = min(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")
    place = [part for part in first["loc"] if part != "[key]"]
    where = _place(place) or "the file"
    if first["type"] == "extra_forbidden":
        known = _known_keys(place[:-1])
        text = f"{path}: unknown key {where}; known here are {', '.join(known)}"
        return InvalidInput(text, hint=meant(str(place[-1]), known), details={"key": where})
    if first["type"] == "missing":
        return InvalidInput(f"{path}: {where} is missing", hint=_WAYS_OUT.get(where, ""), details={"key": where})
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    got = "" if isinstance(first["input"], dict | list | BaseModel) else f", got {first['input']!r}"
    return InvalidInput(f"{path}: {where}: expected {message}{got}", details={"key": where})


def _place(location: list[Any]) -> str:
    """``method.basis``, ``motion[2].rigid.axis``: a key as written in messages (entries counted from 1)."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text


def _known_keys(location: list[Any]) -> list[str]:
    """The known keys of the table at this place."""
    model: type[BaseModel] = CaseFile
    for part in location:
        if isinstance(part, str):
            annotation = model.model_fields[part].annotation
            candidates = [annotation, *get_args(annotation)]
            model = next(c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel))
    return list(model.model_fields)


def toml_key(name: str) -> str:
    """Write a TOML key: bare if possible, quoted otherwise."""
    bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if bare else toml_text(name)


def toml_text(text: str) -> str:
    """A TOML string; other than printable characters are escaped: TOML refuses some, and terminals obey others.

    Raises InvalidInput for the name of a file that is not UTF-8.
    """
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        raise InvalidInput(f"{text!r} is not UTF-8, the encoding of case files", hint="give it another name")
    quoted = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(letter if letter.isprintable() else f"\\U{ord(letter):08x}" for letter in quoted) + '"'

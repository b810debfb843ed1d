"""The mesh format of this project: a NumPy archive, strict, without pickles.

``points`` (n, d) float64; ``cells_<type>`` (m, k) int64 for line, triangle, quad, tetra, hexahedron, wedge, pyramid;
``patch_<name>`` (p,) int64 node ids, 0-based; for a partition also ``global_ids`` (n,) int64, its nodes' numbers in the
whole mesh. Other arrays are refused. Narrower floats and integers are widened.
"""

import re
import zipfile
from pathlib import Path
from typing import TypeVar

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.packages import check_unpacked, reason_of
from mesh_motion_server.files.replace import replacing

_T = TypeVar("_T", bound=np.generic)
#: Errors of damaged archives. RuntimeError: encrypted; MemoryError, OverflowError: a header with more rows than fit in
#: memory.
_DAMAGED = (ValueError, zipfile.BadZipFile, EOFError, KeyError, RuntimeError, MemoryError, OverflowError)
_EXPECTED = "expected 'points', 'cells_<type>' and 'patch_<name>'"
_IDS = "global_ids"


def read_npz(path: Path) -> MeshFile:
    """Read a mesh from ``.npz``.

    Raises InvalidInput if the file is not such an archive, or has other keys or arrays of another kind or shape.
    """
    arrays = read_archive(path)
    unknown = [key for key in arrays if key not in ("points", _IDS) and not key.startswith(("cells_", "patch_"))]
    if unknown or "points" not in arrays:
        raise InvalidInput(f"{path}: {_EXPECTED}, got {', '.join(map(repr, arrays)) or 'nothing'}")
    points = _as(arrays.pop("points"), "fiu", np.float64, f"{path}: points")
    integers = {key: _as(value, "iu", np.int64, f"{path}: {key}") for key, value in arrays.items()}
    cells = {key.removeprefix("cells_"): v for key, v in integers.items() if key.startswith("cells_")}
    patches = {key.removeprefix("patch_"): v for key, v in integers.items() if key.startswith("patch_")}
    for name, nodes in patches.items():
        if nodes.ndim != 1:
            raise InvalidInput(f"{path}: patch_{name}: expected shape (p,), got {nodes.shape}")
    ids = integers.get(_IDS)
    if ids is not None and ids.shape != points.shape[:1]:
        raise InvalidInput(f"{path}: {_IDS}: expected shape {points.shape[:1]}, one for each point, got {ids.shape}")
    return MeshFile(points, cells, {name: np.unique(nodes) for name, nodes in patches.items()}, path, global_ids=ids)


def write_npz(path: Path | str, mesh: MeshFile) -> None:
    """Write a mesh as ``.npz`` (compressed), replacing the file in one step."""
    arrays: dict[str, NDArray[np.generic]] = {"points": mesh.points}
    arrays |= {f"cells_{name}": nodes for name, nodes in mesh.cells.items()}
    arrays |= {f"patch_{name}": nodes for name, nodes in mesh.patches.items()}
    if mesh.global_ids is not None:
        arrays[_IDS] = mesh.global_ids
    with replacing(Path(path)) as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]  # none has the name of an argument


def read_points(path: Path, shape: tuple[int, ...]) -> Floats:
    """Read coordinates from a ``.npy`` file, such as ``points.npy`` of a run.

    Raises InvalidInput if it is not such a file, or if its content is not finite numbers of this shape.
    """
    try:
        with path.open("rb") as file:
            points = np.lib.format.read_array(file, allow_pickle=False)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, EOFError, MemoryError, OverflowError) as error:
        raise InvalidInput(f"{path}: not readable as a .npy file of plain numbers: {reason_of(error)}") from None
    if points.dtype.kind != "f" or points.shape != shape or not bool(np.isfinite(points).all()):
        got = f"{points.dtype} of shape {points.shape}"
        raise InvalidInput(f"{path}: expected finite real coordinates of shape {shape}, got {got}")
    return points.astype(np.float64)


def read_archive(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read all arrays of a ``.npz`` file without unpickling.

    Raises InvalidInput if it is not an archive of plain arrays.
    """
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if isinstance(archive, np.ndarray):
                raise InvalidInput(f"{path}: a single array, not an .npz archive")
            held = sum(member.file_size for member in archive.zip.infolist())
            check_unpacked(path, path.stat().st_size, held)
            return {key: archive[key] for key in archive.files}
    except _DAMAGED as error:
        raise InvalidInput(f"{path}: not readable as an .npz archive of plain arrays: {reason_of(error)}") from None


def _as(array: NDArray[np.generic], kinds: str, dtype: type[_T], what: str) -> NDArray[_T]:
    """Return the array as ``dtype``; refuse kinds that cannot be converted without loss."""
    if array.dtype.kind not in kinds:
        wanted = "integers" if "f" not in kinds else "real numbers"
        raise InvalidInput(f"{what}: expected {wanted}, got dtype {array.dtype}", code="INVALID_ARGUMENT.DTYPE")
    return np.ascontiguousarray(array, dtype=dtype)


NPZ = Format("a NumPy archive", (".npz",), re.compile(rb"\APK\x03\x04"), read_npz)

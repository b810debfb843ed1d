"""The nodes of a CGNS file in HDF5: each is a group with a label and an optional array, or a link to such a group.

https://cgns.github.io/CGNS_docs_current/hdf5/index.html
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.hdf5 import opened_hdf5, whole_of
from mesh_motion_server.files.text import text_of

_ADF = b"\xc0\xa8\xa3\xa9ADF"  # "@(#)ADF" with high bits
_DATA = " data"
#: CGNS links are nodes of this type; they have the HDF5 link under this name.
_LINK, _LINK_DATA = b"LK", " link"


@contextmanager
def open_cgns(path: Path) -> Iterator[Node]:
    """The root node of a file.

    Raises InvalidInput if it is no HDF5 file, or if h5py raises an error because the file is damaged.
    """
    with path.open("rb") as file:
        beginning = file.read(32)
    if _ADF in beginning:
        raise InvalidInput(
            f"{path}: a CGNS file in the old ADF format", hint=f"adf2hdf {path.name} converts it to HDF5"
        )
    with opened_hdf5(path, "CGNS file") as root:
        yield Node(path, "/", root)


@dataclass(frozen=True, eq=False)
class Node:
    """One node; ``group`` is the group of h5py."""

    path: Path
    name: str
    group: Any

    def refused(self, reason: str, hint: str = "") -> InvalidInput:
        """An error that names the file and the node."""
        return InvalidInput(f"{self.path}: {self.name}: {reason}", hint=hint)

    @property
    def label(self) -> str:
        """The label (type) of the node, such as ``Zone_t``."""
        value = self.group.attrs.get("label", b"")
        text = value.decode("ascii", errors="replace") if isinstance(value, bytes) else str(value)
        return text.rstrip("\0 ")

    def children(self, label: str) -> list[Node]:
        """The nodes under this one with a label, in the order of their names."""
        nodes = [self._child(name) for name in self.group if name != _DATA]
        return [node for node in nodes if node is not None and node.label == label]

    def child(self, name: str) -> Node | None:
        """The node under this one with a name."""
        return self._child(name) if name in self.group else None

    def _child(self, name: str) -> Node | None:
        found = self._followed(self.group, name)
        if hasattr(found, "keys") and found.attrs.get("type") == _LINK:
            found = self._followed(found, _LINK_DATA)
        return Node(self.path, name, found) if hasattr(found, "keys") else None

    def _followed(self, group: Any, name: str) -> Any:
        """The object with a name in an HDF5 group; links to other files are followed."""
        found, link = group.get(name), group.get(name, getlink=True)
        if found is None and hasattr(link, "path"):
            place = f" in {link.filename}" if hasattr(link, "filename") else ""
            raise self.refused(f"a link to {link.path}{place}, which is not there")
        return found

    def only(self, label: str, what: str) -> Node:
        """The only node under this one with a label. Raises InvalidInput if there are none or several."""
        found = self.children(label)
        if len(found) != 1:
            names = f": {', '.join(node.name for node in found[:8])}" if found else ""
            raise self.refused(f"{len(found)} {what}{names}; one is expected")
        return found[0]

    def text(self) -> str:
        """The array as characters."""
        return text_of(self._array("iuS").tobytes()).rstrip("\0 ") if self._has_data else ""

    def integers(self) -> Integers:
        """(k,) the array, in the order of the file."""
        return self._array("iu").astype(np.int64).ravel()

    def reals(self) -> Floats:
        """(k,) the array as real numbers."""
        return self._array("f").astype(np.float64).ravel()

    def replace(self, values: Floats) -> None:
        """Overwrite the array, in a file that is open for changes."""
        self.group[_DATA][...] = values.reshape(self.group[_DATA].shape)

    @property
    def _has_data(self) -> bool:
        return _DATA in self.group

    def _array(self, kinds: str) -> NDArray[Any]:
        """Return the array; refuse it if its numbers are of another kind, or if it is not in the file."""
        data = self.group.get(_DATA)
        if data is None or not hasattr(data, "dtype"):
            raise self.refused("it has no data")
        if data.dtype.kind not in kinds:
            raise self.refused(f"data of type {data.dtype}, expected {'real numbers' if kinds == 'f' else 'integers'}")
        return whole_of(self.path, data)

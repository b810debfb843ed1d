"""An XDMF file: its elements with their inclusions and references, and the numbers of its items."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files.packages import check_unpacked, load_h5py
from mesh_motion_server.files.text import integer, number_array

#: Also as MOOSE (2003), dolfinx (https) and meshio (a slash at the end) write it.
_INCLUDE = re.compile(r"\{https?://www\.w3\.org/200[13]/XInclude/?\}include")
_CHOICE = re.compile(r"/\*\[((?:\s*(?:or)?\s*self::\w+)+)\s*\]$")
_KINDS = {"float": "f", "int": "i", "uint": "u", "char": "i", "uchar": "u", "short": "i", "ushort": "u"}
_SHORT = {"char": 1, "uchar": 1, "short": 2, "ushort": 2}


@dataclass(eq=False)
class Document:
    """An XDMF file, its elements with inclusions, and the files of its numbers."""

    path: Path
    root: ElementTree.Element
    packed: int
    open_files: dict[Path, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path) -> "Document":
        data = path.read_bytes()
        try:
            return cls(path, ElementTree.fromstring(data), len(data))
        except ElementTree.ParseError as error:
            raise ValueError(str(error)) from None

    def close(self) -> None:
        """Close the files of the numbers."""
        for file in self.open_files.values():
            file.close()

    def found(self, path: str) -> list[ElementTree.Element]:
        """The elements at an XPath in the form of XDMF's references."""
        place = re.sub(r"^(xpointer|element)\((.*)\)$", r"\2", path.strip())
        choice = _CHOICE.search(place)
        tags = re.findall(r"self::(\w+)", choice[1]) if choice else []
        place = place[: choice.start()] if choice else place
        place = f".{place}" if place.startswith("//") else re.sub(rf"^/{self.root.tag}/", "./", place)
        try:
            found = self.root.findall(place)
        except SyntaxError:
            found = []
        found = [child for one in found for child in one if child.tag in tags] if tags else found
        if not found:
            raise ValueError(f"the reference {path.strip()!r} has no target")
        return found

    def children(self, parent: ElementTree.Element, tag: str) -> list[ElementTree.Element]:
        """Elements of a kind inside another element, including inclusions."""
        found = []
        for child in parent:
            listed = [child]
            if _INCLUDE.fullmatch(child.tag):  # of several elements in one place, XDMF uses the first
                listed = self.found(child.get("xpointer", ""))
                listed = listed if len({one.tag for one in listed}) == len(listed) else listed[:1]
            elif child.get("Reference"):
                listed = self.found(
                    child.get("Reference", "") if child.get("Reference") != "XML" else child.text or ""
                )[:1]
            found += [one for one in listed if one.tag == tag]
        return found

    def item(self, parent: ElementTree.Element, number: int = 0) -> ElementTree.Element:
        """The item of numbers of an element."""
        items = self.children(parent, "DataItem")
        if len(items) <= number:
            raise ValueError(f"{parent.tag} {parent.get('Name', '')!r} has {len(items)} items, expected {number + 1}")
        kind = item_type(items[number])
        if kind not in ("uniform", "hyperslab"):
            raise ValueError(f"{parent.tag} {parent.get('Name', '')!r}: items of type {kind} are not read")
        return items[number]

    def values(self, item: ElementTree.Element) -> NDArray[Any]:
        """The numbers of an item in its shape; those of a hyperslab are a part of another item's."""
        shape = [integer(word) for word in item.get("Dimensions", "").split()]
        form, text = item.get("Format", "XML").lower(), (item.text or "").strip()
        dtype = dtype_of(item)
        if item_type(item) == "hyperslab":
            values = self._part(item)
        elif form == "hdf":
            values = self._hdf5(text)
        elif form == "binary":
            raw = self.file_of_numbers(text).read_bytes()[integer(item.get("Seek", "0")) :]
            values = np.frombuffer(raw, dtype, count=int(np.prod(shape, dtype=np.int64)))
        elif form == "xml":
            words = text.split()
            try:
                values = number_array(words, np.int64 if dtype[1] in "iu" else np.float64)
            except ValueError:
                values = number_array(words, np.float64)
        else:
            raise ValueError(f"an item of the format {form}, expected XML, HDF or Binary")
        if values.size != int(np.prod(shape, dtype=np.int64)):
            raise ValueError(f"an item of {values.size} numbers, but Dimensions {item.get('Dimensions')!r}")
        return values.reshape(shape)

    def file_of_numbers(self, name: str) -> Path:
        """A file of numbers that this file names."""
        place = self.path.parent / name
        if not place.is_file():
            raise ValueError(f"there is no {place}, which should hold its numbers")
        return place

    def _part(self, slab: ElementTree.Element) -> NDArray[Any]:
        """The part of an array that three rows of numbers select: starts, strides and counts in each direction."""
        rows, whole = (self.values(self.item(slab, number)) for number in (0, 1))
        if rows.size != 3 * whole.ndim:
            raise ValueError(f"a hyperslab with {rows.size} numbers for an array of {whole.ndim} directions")
        start, stride, count = rows.astype(np.int64).reshape(3, -1)
        last = start + stride * (count - 1)
        wrong = np.flatnonzero((start < 0) | (stride < 1) | (count < 1) | (last >= whole.shape))
        if len(wrong):
            axis = int(wrong[0])
            raise ValueError(
                f"a hyperslab from {start[axis]} to {last[axis]} by {stride[axis]} in direction {axis}, in which the "
                f"array has {whole.shape[axis]} rows"
            )
        return whole[tuple(slice(*of) for of in zip(start, last + 1, stride, strict=True))]

    def _hdf5(self, text: str) -> NDArray[Any]:
        name, _, inner = text.rpartition(":")
        place = self.file_of_numbers(name.strip())
        if place not in self.open_files:
            self.open_files[place] = load_h5py(place).File(place, "r", locking=False)
        data = self.open_files[place][inner.strip()]
        if getattr(data, "dtype", None) is None or data.dtype.kind not in "iuf":
            raise ValueError(f"{text}: expected an array of numbers")
        check_unpacked(place, data.id.get_storage_size(), data.nbytes)
        return np.asarray(data[()])


def item_type(item: ElementTree.Element) -> str:
    return item.get("ItemType", item.get("Type", "Uniform")).lower()


def dtype_of(item: ElementTree.Element) -> str:
    """NumPy's type of the numbers of an item."""
    kind = item.get("NumberType", item.get("DataType", "Float")).lower()
    order = ">" if item.get("Endian", "").lower() == "big" else "<"
    return f"{order}{_KINDS.get(kind, 'f')}{_SHORT.get(kind, int(item.get('Precision', '4')))}"


def kind_of(element: ElementTree.Element) -> str:
    """The type of a topology or a geometry, lower case."""
    return element.get(f"{element.tag}Type", element.get("Type", "XYZ")).lower()

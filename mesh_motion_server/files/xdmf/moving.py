"""Writes an XDMF file with moved nodes, and copies of the files of its numbers."""

import shutil
from contextlib import closing
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.moved import Place, companions, copied_hdf5, edit, replaced
from mesh_motion_server.files.replace import replaced_by_name
from mesh_motion_server.files.xdmf.document import Document, dtype_of, item_type, kind_of
from mesh_motion_server.files.xdmf.grids import WIDTHS, by_points


def _texts(data: bytes) -> list[tuple[int, int]]:
    """Begin and end of each item's text in the file, in the order of the begins."""
    found: list[list[int]] = []
    open_items: list[list[int]] = []
    parser = expat.ParserCreate()

    def start(tag: str, _: dict[str, str]) -> None:
        if tag == "DataItem":
            found.append([])
            open_items.append(found[-1])

    def text(_: str) -> None:
        if open_items and not open_items[-1]:
            open_items[-1].append(parser.CurrentByteIndex)

    def end(tag: str) -> None:
        if tag == "DataItem":
            item = open_items.pop()
            item[:] = [*item[:1], parser.CurrentByteIndex] if item else [parser.CurrentByteIndex] * 2

    parser.StartElementHandler, parser.CharacterDataHandler, parser.EndElementHandler = start, text, end
    parser.Parse(data, True)
    return [(item[0], item[1]) for item in found]


def move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates, and copies of the files of its numbers, named after it."""
    with closing(Document.of(source)) as file:
        (geometry, *others) = [of for of, _ in by_points(file)]
        if others or kind_of(geometry) not in WIDTHS:
            raise InvalidInput(
                f"{source}: {'grids with points of their own' if others else 'a grid without a list of points'}",
                hint="take .vtu",
            )
        apart = "_" in kind_of(geometry)
        own = [file.item(geometry, axis) for axis in range(points.shape[1] if apart else 1)]
        columns = [points[:, [axis]] for axis in range(points.shape[1])] if apart else [points]
        if any(item_type(item) != "uniform" for item in own):
            raise InvalidInput(f"{source}: its points are a part of a larger array (HyperSlab)", hint="take .vtu")
        places = dict(zip(own, columns, strict=True))
        width = 1 if apart else WIDTHS[kind_of(geometry)]
        items = [*file.root.iter("DataItem")]
        names = _copies(file, items, target)
    data = source.read_bytes()
    changes = []
    for item, (begin, end) in zip(items, _texts(data), strict=True):
        name, colon, inner = _named(item)
        if name:
            changes.append((begin, end, f"{names[name]}{colon}{inner}".encode()))
        elif item in places:
            place = Place(len(points), 0, width, text=(0, end - begin))
            changes.append((begin, end, replaced(data[begin:end], [place], places[item])))
    for name, new in names.items():
        moved = {item: values for item, values in places.items() if _named(item)[0] == name}
        _copy(source.parent / name, target.parent / new, moved, width)

    def change(content: bytes) -> bytes:
        for begin, end, text in reversed(changes):
            content = content[:begin] + text + content[end:]
        return content

    edit(source, target, change)


def _named(item: ElementTree.Element) -> tuple[str, str, str]:
    """The file with the numbers of an item, ":" and the place in it; "" if the numbers are in the XML itself."""
    form, text = item.get("Format", "XML").lower(), (item.text or "").strip()
    if form == "hdf":
        name, colon, inner = text.rpartition(":")
        return name.strip(), colon, inner
    return (text, "", "") if form == "binary" else ("", "", "")


def _copies(file: Document, items: list[ElementTree.Element], target: Path) -> dict[str, str]:
    """{name of a file of numbers: the name of its copy}."""
    names: dict[str, str] = {}
    for item in items:
        name = _named(item)[0]
        if name and name not in names:
            file.file_of_numbers(name)
            names[name] = f"{companions(target)}{f'_{len(names)}' if names else ''}{Path(name).suffix}"
    for name, new in names.items():
        place = target.parent / new
        other = next(
            (one for one in names if place.exists() and one != name and file.file_of_numbers(one).samefile(place)), ""
        )
        if other:
            raise InvalidInput(
                f"{target}: the copy of {name} would replace {other}", hint="take another name or folder"
            )
    return names


def _copy(source: Path, target: Path, moved: dict[ElementTree.Element, Floats], width: int) -> None:
    """Copy a file of numbers, with other coordinates in the items that are ``moved``."""
    if not moved:
        with replaced_by_name(target) as partial:
            shutil.copyfile(source, partial)
    elif next(iter(moved)).get("Format", "").lower() == "hdf":
        with copied_hdf5(source, target) as file:
            for item, values in moved.items():
                data = file[_named(item)[2].strip()]
                columns = data[()].reshape(-1, width)
                columns[:, : values.shape[1]] = values
                data[...] = columns.reshape(data.shape)
    else:
        places = [
            Place(len(values), int(item.get("Seek", "0")), width * int(dtype[2:]), dtype=dtype)
            for item, values in moved.items()
            for dtype in [dtype_of(item)]
        ]
        edit(source, target, lambda data: _raw(data, places, [*moved.values()]))


def _raw(data: bytes, places: list[Place], values: list[Floats]) -> bytes:
    for place, one in zip(places, values, strict=True):
        data = replaced(data, [place], one)
    return data

"""Input of Abaqus and CalculiX: ``*NODE``, ``*ELEMENT``, ``*NSET``, ``*ELSET`` and ``*SURFACE``.

Surfaces and sets of nodes become patches; so do sets of elements of lower dimension than the mesh. Where such elements
are listed with a name (``*ELEMENT, ELSET=Surface1``) and are all in other sets, only those count. Keywords that do not
describe the mesh are skipped. ``*INCLUDE`` reads files in the folder of the input and below it, each once. Only one
part or instance is read: Abaqus counts the nodes of each apart.

http://www.dhondt.de/ccx_2.20.pdf, chapter 7
"""

import os
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cell_facets import facet_nodes, matched_facets
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, all_outside, assemble_elements, by_name, concatenated
from mesh_motion_server.files.moved import edit
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.sides import ABAQUS, PLANES, SHELLS, SOLIDS, side_nodes
from mesh_motion_server.files.text import integer, real, text_of

#: A type's name ends with its number of nodes and letters for the integration: C3D8, C3D20R, CPS4, F3D8, STRI65.
_LINES = {2: "line", 3: "line"}
_FAMILIES = (
    (re.compile(r"(?:[DAEQ]?C3D|F3D|FC3D|CSS|SC)(\d+)"), SOLIDS, False),
    (re.compile(r"(?:[DA]?C(?:PS|PE|PEG|AX|2D)|F2D|MAX)(\d+)"), PLANES, False),
    (re.compile(r"(?:M3D|SFM3D|R3D|DS|STRI|[SM])(\d)"), PLANES, True),  # two faces, and edges
    (re.compile(r"[TR][23]D(\d+)"), _LINES, False),
)
#: Keywords that make nodes or elements out of those that are listed.
_MAKING = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"}
_ALL_LISTED = "Abaqus/CAE writes one list of nodes with noPartsInputFile=ON, under Model, Edit Attributes"

#: A keyword that may have its data in another file, and its parameters; after a comma at the end of a line they go on.
_READING = re.compile(rb"(?im)^[ \t]*\*[ \t]*(INCLUDE|NODE|ELEMENT|NSET|ELSET|SURFACE)\b((?:.*,[ \t\r]*\n)*.*)$")
_INPUT = re.compile(rb"(?i),\s*INPUT\s*=\s*(\"[^\"\n]*\"|[^,\r\n]+)")


#: Largest number of numbers that a set may name in one line; most of them may not exist.
_MOST_GENERATED = 50_000_000
#: An item of a set: a number, a range of generated numbers, or the name of another set.
_Item = int | range | str


@dataclass(frozen=True, eq=False)
class _Block:
    """Elements of one keyword: our type, their numbers (m,), their nodes (m, k), and whether they are shells."""

    name: str
    ids: Integers
    nodes: Integers
    shell: bool


@dataclass(eq=False)
class _Content:
    """The content read so far; numbers of nodes and elements are those of the file.

    of_nodes, of_elements : sets that are named where their nodes or elements are
    nodes_of : the sets of elements that sets of nodes name, ``*NSET, NSET=A, ELSET=B``
    parts, instances : names of parts, and of instances of parts
    left_out : {type of elements that are not read: their numbers}
    """

    numbers: list[Integers] = field(default_factory=list)
    points: list[Floats] = field(default_factory=list)
    elements: list[_Block] = field(default_factory=list)
    node_sets: dict[str, list[_Item]] = field(default_factory=lambda: defaultdict(list))
    of_nodes: set[str] = field(default_factory=set)
    of_elements: set[str] = field(default_factory=set)
    element_sets: dict[str, list[_Item]] = field(default_factory=lambda: defaultdict(list))
    surfaces: dict[str, list[tuple[str, str]]] = field(default_factory=lambda: defaultdict(list))
    nodes_of: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    parts: list[str] = field(default_factory=list)
    instances: list[str] = field(default_factory=list)
    left_out: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.inp``.

    Raises InvalidInput for several parts, unknown elements of a volume, sets of missing nodes or elements, and
    malformed lines; names the keyword and line.
    """
    try:
        return _mesh(path, _content(text_of(_whole(path, path.resolve().parent, set()))))
    except (ValueError, IndexError, KeyError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed input of Abaqus or CalculiX: {error}") from None


def _whole(path: Path, folder: Path, seen: set[Path]) -> bytes:
    """The content of a file, with the content of the files that it includes."""
    found = path.resolve()
    if not found.is_relative_to(folder) or not found.is_file() or found in seen:
        missing = "not there: run the pre-processor that writes it (cgx, for example), or copy it there"
        reason = "included twice" if found in seen else missing if found.is_relative_to(folder) else "not in its folder"
        raise ValueError(f"*INCLUDE of {path.name!r}, which is {reason}")
    seen.add(found)

    def inserted(keyword: re.Match[bytes]) -> bytes:
        if (given := _INPUT.search(keyword[2])) is None:
            return keyword[0]
        content = _whole(folder / os.fsdecode(given[1].strip().strip(b'"')), folder, seen)
        parameters = keyword[2].replace(given[0], b"")
        return content if keyword[1].upper() == b"INCLUDE" else b"*" + keyword[1] + parameters + b"\n" + content

    return _READING.sub(inserted, found.read_bytes())


def _blocks(text: str) -> Iterator[tuple[int, str, dict[str, str], list[str]]]:
    """Yield line number, keyword, parameters, and the data lines of each keyword."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("**")]
    starts = [place for place, (_, line) in enumerate(lines) if line.startswith("*")]
    if not starts:
        raise ValueError("it has no keyword")
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        number, head = lines[start]
        keyword, *rest = (part.strip() for part in head[1:].split(","))
        data = [line for _, line in lines[start + 1 : end]]
        while head.endswith(",") and data:  # parameters continue on the next line
            head = data.pop(0)
            rest += [part.strip() for part in head.split(",")]
        pairs = (part.partition("=") for part in rest if part)
        parameters = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
        yield number, " ".join(keyword.upper().split()), parameters, data


def _content(text: str) -> _Content:
    """Read all keywords that describe the mesh."""
    found, first_spelled = _Content(), dict[tuple[str, str], str]()
    for number, keyword, given, lines in _blocks(text):
        for key in {"NSET", "ELSET", "NAME"} & {*given}:  # upper and lower case are the same
            kind = keyword if key == "NAME" else key
            given[key] = first_spelled.setdefault((kind, given[key].upper()), given[key])
        try:
            match keyword:
                case "PART":
                    found.parts.append(given["NAME"])
                case "INSTANCE":
                    _add_instance(found, given["NAME"], moved=bool(lines))
                case _ if keyword in _MAKING:
                    raise ValueError("it generates nodes or elements; write each node and each element in a row")
                case "SYSTEM" if lines:
                    raise ValueError("nodes in a local coordinate system; write them in global coordinates")
                case "NODE":
                    _add_nodes(found, given, lines)
                case "ELEMENT":
                    _add_elements(found, given, lines)
                case "NSET" | "ELSET":
                    sets = found.node_sets if keyword == "NSET" else found.element_sets
                    sets[given[keyword]] += _listed(found, lines, generate="GENERATE" in given)
                    if keyword == "NSET" and "ELSET" in given:
                        found.nodes_of[given["NSET"]].append(given["ELSET"])
                case "SURFACE":
                    _add_surface(found, given, lines)
        except (ValueError, IndexError, KeyError) as error:
            raise ValueError(f"*{keyword} in line {number}: {error}") from None
    found.node_sets.pop("", None)
    found.element_sets.pop("", None)
    return found


def _add_instance(found: _Content, name: str, *, moved: bool) -> None:
    """Note the instance of the only part, whose nodes are where it lists them."""
    found.instances.append(name)
    if len(found.instances) > 1 or moved:
        what = "is moved to its place" if moved else f"follows {found.instances[0]!r}"
        raise ValueError(f"{name!r} {what}, but one that stays is read; {_ALL_LISTED}")


def _add_nodes(found: _Content, given: dict[str, str], lines: list[str]) -> None:
    if given.get("SYSTEM", "R").upper() != "R":
        raise ValueError(f"SYSTEM={given['SYSTEM']}, expected Cartesian coordinates")
    rows = [[word.strip() for word in line.split(",")] for line in lines]
    found.numbers.append(np.array([integer(row[0]) for row in rows], dtype=np.int64))
    xyz = [[real(word or "0") for word in (row[1:4] + [""] * 3)[:3]] for row in rows]  # blank ones are zero
    found.points.append(np.array(xyz, dtype=np.float64).reshape(-1, 3))
    found.of_nodes.add(given.get("NSET", ""))
    found.node_sets[given.get("NSET", "")] += found.numbers[-1].tolist()


def _add_surface(found: _Content, given: dict[str, str], lines: list[str]) -> None:
    rows = [_words(line) for line in lines]
    if given.get("TYPE", "ELEMENT").upper() == "NODE":
        found.node_sets[given["NAME"]] += [item for row in rows for item in _items(found, row[:1])]
        return
    if "COMBINE" in given:
        raise ValueError(f"COMBINE={given['COMBINE']} of other surfaces; list its elements and their sides")
    found.surfaces[given["NAME"]] += [(_plain(found, row[0]), "".join(row[1:2])) for row in rows]


def _words(line: str) -> list[str]:
    return [word.strip().strip('"') for word in line.split(",") if word.strip()]


def _plain(found: _Content, word: str) -> str:
    """A number or a name without that of its instance: ``Part-1-1.7``."""
    beginnings = [f"{name}.".upper() for name in found.instances]
    return next((word[len(start) :] for start in beginnings if word.upper().startswith(start)), word)


def _items(found: _Content, words: list[str]) -> list[_Item]:
    """Numbers, and names of other sets."""
    plain = [_plain(found, word) for word in words]
    return [integer(word) if word.lstrip("-").isdigit() else word for word in plain]


def _listed(content: _Content, lines: list[str], *, generate: bool) -> list[_Item]:
    """The items of a set."""
    if not generate:
        return [item for line in lines for item in _items(content, _words(line))]
    found: list[_Item] = []
    for line in lines:
        first, *more = (integer(word) for word in _words(line))
        last, *steps = more or [first]
        if min(steps, default=1) < 1:
            raise ValueError(f"an increment of {min(steps)}, expected at least 1")
        numbers = range(first, last + 1, *steps)
        if last - first >= _MOST_GENERATED * numbers.step:
            raise ValueError(f"more than {_MOST_GENERATED} numbers from {first} to {last}")
        found.append(numbers)
    return found


def _add_elements(found: _Content, given: dict[str, str], lines: list[str]) -> None:
    """Add the elements of one keyword; elements that are not cells, such as springs, are left out."""
    kind = given["TYPE"].upper()
    matches = ((family.match(kind), types, shell) for family, types, shell in _FAMILIES)
    size, types, shell = next(
        ((integer(match[1]), types, shell) for match, types, shell in matches if match), (0, {}, False)
    )
    if size not in types:
        found.left_out[kind] |= {
            integer(words[0]) for line in lines if (words := _words(line)) and words[0].isdecimal()
        }
        return
    flat = np.array([integer(word) for line in lines for word in _words(line)], dtype=np.int64)
    if len(flat) % (size + 1):
        gmsh = "; Gmsh calls wedges of 18 nodes so: set its option Mesh.SecondOrderIncomplete = 1"
        more = gmsh if (size, len(flat) % 19) == (6, 0) else ""
        raise ValueError(f"elements {kind} of {size} nodes, but {len(flat)} numbers follow{more}")
    rows = flat.reshape(-1, size + 1)
    found.elements.append(_Block(types[size], rows[:, 0], rows[:, 1:], shell))
    found.of_elements.add(given.get("ELSET", ""))
    found.element_sets[given.get("ELSET", "")] += rows[:, 0].tolist()


def _flat(sets: dict[str, list[_Item]], name: str, seen: tuple[str, ...] = ()) -> Integers:
    """The numbers of a set and of the sets that it names."""
    key = next((key for key in sets if key.upper() == name.upper()), None)
    if key is None or name.upper() in seen:
        raise ValueError(f"there is no set {name!r}")
    parts = [
        _flat(sets, item, (*seen, name.upper())) if isinstance(item, str) else _numbers(item) for item in sets[key]
    ]
    return np.concatenate([np.empty(0, np.int64), *parts])


def _numbers(item: int | range) -> Integers:
    return np.arange(item.start, item.stop, item.step) if isinstance(item, range) else np.array([item], dtype=np.int64)


def _mesh(path: Path, found: _Content) -> MeshFile:
    if not found.points or not found.elements:
        what = f"; its elements are of type {', '.join(sorted(found.left_out))}" if found.left_out else ""
        raise InvalidInput(
            f"{path}: no nodes, or no elements of a volume or a plane{what}",
            hint="beams, springs and networks are not cells: give the mesh of the space that moves",
        )
    try:
        rows, points = NumberedRows.of(np.concatenate(found.numbers)), np.concatenate(found.points)
    except ValueError as error:
        apart = f", because each of {len(found.parts)} parts counts its own; {_ALL_LISTED}"
        raise ValueError(f"{error}{apart if len(found.parts) > 1 else ''}") from None
    blocks = [replace(block, nodes=rows(block.nodes)) for block in found.elements]
    cells = [(block.name, block.nodes) for block in blocks]
    dimension = max(CELL_TYPES[name].dimension for name, _ in cells)
    parts_of: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
    for name, parts in found.surfaces.items():
        for items, side in parts:
            own = np.array([integer(items)]) if items.isdigit() else _flat(found.element_sets, items)
            _require_read(found, own)
            sides = _surface(blocks, own, side, plane=dimension == 2) if side else [_free(blocks, own, dimension)]
            for of in sides:
                parts_of[name].append((dimension - 1, of.ravel()))
    for name in found.node_sets:
        of_elements = [_flat(found.element_sets, other) for other in found.nodes_of.get(name, ())]
        nodes = [block.nodes[np.isin(block.ids, of)].ravel() for of in of_elements for block in blocks]
        listed = rows(_flat(found.node_sets, name), f"set {name!r}: node")
        own = np.unique(np.concatenate([listed, *nodes]))
        # the set of all nodes is not a patch, except that of both sides of one layer of elements
        if not _filled(found, name, blocks, dimension, own) and (
            len(own) < len(points) or (name not in found.of_nodes and all_outside(cells, len(points)))
        ):
            parts_of[name].append((0, own))
    for name, own in _sides(found, blocks, dimension).items():
        for block in blocks:
            if (inside := np.isin(block.ids, own)).any():
                parts_of[name].append((CELL_TYPES[block.name].dimension, block.nodes[inside].ravel()))
    patches, notes = by_name(parts_of)
    nodes_of = {name: nodes for name, nodes in patches.items() if len(nodes)}
    mesh = assemble_elements(path, points, cells, nodes_of)
    notes += [f"its elements of type {', '.join(sorted(found.left_out))} are not read"] * bool(found.left_out)
    return replace(mesh, notes=(*mesh.notes, *notes))


def _filled(found: _Content, name: str, blocks: list[_Block], dimension: int, own: Integers) -> bool:
    """Whether a set of nodes has all nodes of the cells in the set of elements with its name: CAE writes both."""
    if not any(key.upper() == name.upper() for key in found.element_sets):
        return False
    ids = _flat(found.element_sets, name)
    inside = [of.nodes[np.isin(of.ids, ids)].ravel() for of in blocks if CELL_TYPES[of.name].dimension == dimension]
    nodes = np.concatenate(inside)
    return len(nodes) > 0 and bool(np.isin(nodes, own).all())


def _require_read(found: _Content, own: Integers) -> None:
    """Refuse a side of an element that is not there, or that is not read."""
    missing = np.setdiff1d(own, np.concatenate([block.ids for block in found.elements]))
    if len(missing):
        kind = next((kind for kind, numbers in found.left_out.items() if missing[0] in numbers), None)
        reason = f"is of type {kind}, which is not read" if kind else "does not exist"
        raise ValueError(f"element {int(missing[0])} is named, but {reason}")


def _sides(found: _Content, blocks: list[_Block], dimension: int) -> dict[str, Integers]:
    """The sets of elements (k,) of lower dimension only, but those named with their elements that others have."""
    cells = np.concatenate([block.ids for block in blocks if CELL_TYPES[block.name].dimension == dimension])
    lower = np.concatenate(
        [block.ids for block in blocks if CELL_TYPES[block.name].dimension < dimension] or [cells[:0]]
    )
    flat = {name: _flat(found.element_sets, name) for name in found.element_sets}
    sets = {name: own for name, own in flat.items() if np.isin(own, lower).any() and not np.isin(own, cells).any()}
    others = np.concatenate([cells[:0], *(own for name, own in sets.items() if name not in found.of_elements)])
    return {name: own for name, own in sets.items() if name not in found.of_elements or not np.isin(own, others).all()}


def _surface(blocks: list[_Block], own: Integers, side: str, *, plane: bool) -> Iterator[Integers]:
    """Nodes of one side of elements, which may be of several types.

    Sides are S1, S2, …. Those of shells are the faces S1 = SNEG and S2 = SPOS, then the edges S3, S4, … of CalculiX,
    which are Abaqus' E1, E2, …. Faces of plane elements are SN and SP. In a mesh in the plane, faces are the mesh.
    """
    found = re.fullmatch(r"(S|E)([1-9])|S(?:POS|NEG|P|N)", side.upper())
    if found is None:
        raise ValueError(f"side {side!r}, expected S1, S2, …, of shells also E1, E2, …, SPOS, SNEG")
    for block in blocks:
        chosen = block.nodes[np.isin(block.ids, own)]
        as_shell = block.shell or found[1] != "S"
        number = integer(found[2] or "1") + 2 * (found[1] == "E")
        if not (plane and as_shell and number <= 2):
            sides = np.full(len(chosen), number)
            yield side_nodes(block.name, chosen, sides, SHELLS if as_shell else ABAQUS)


def _free(blocks: list[_Block], own: Integers, dimension: int) -> Integers:
    """The nodes of the sides of these elements that belong to no other element, as Abaqus takes them for no side."""
    ids: dict[str, list[Integers]] = defaultdict(list)
    corners: dict[str, list[Integers]] = defaultdict(list)
    for block in blocks:
        if (kind := CELL_TYPES[block.name]).dimension == dimension:
            ids[block.name].append(block.ids)
            corners[block.name].append(block.nodes[:, : kind.n_nodes])
    cells = CellTable.from_arrays(concatenated(corners))
    single, _, _ = matched_facets(cells)
    of_cells = np.concatenate([np.concatenate(ids[block.type.name]) for block in cells])
    nodes = facet_nodes(cells, single[np.isin(of_cells[single // 8], own)]).astype(np.int64)
    return nodes[nodes >= 0]


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes; with its included files as one, if nodes are in these."""

    def changed(data: bytes) -> bytes:
        lines, rows = _node_rows(data)
        if len(rows) < len(points):
            lines, rows = _node_rows(_whole(source, source.resolve().parent, set()))
        for row, values in zip(rows, points.tolist(), strict=True):
            lines[row] = _moved(lines[row], values)
        return b"".join(lines)

    edit(source, target, changed)


def _node_rows(data: bytes) -> tuple[list[bytes], list[int]]:
    """The lines of a file, and the places of those of its nodes."""
    lines, rows = data.splitlines(keepends=True), list[int]()
    in_nodes = in_keyword = False
    for place, line in enumerate(lines):
        text = line.strip()
        if not text or text.startswith(b"**"):
            continue
        if starts := text.startswith(b"*"):
            in_nodes = re.match(rb"(?i)\*\s*NODE\s*(,|$)", text) is not None
        elif in_nodes and not in_keyword:
            rows.append(place)
        in_keyword = (starts or in_keyword) and text.endswith(b",")  # its parameters go on in the next line
    return lines, rows


def _moved(line: bytes, values: list[float]) -> bytes:
    """The row of a node with other coordinates; they may be blank or left out where they are zero."""
    fields = line.rstrip(b"\r\n").split(b",")
    end = line[len(line.rstrip(b"\r\n")) :]
    fields += [b" "] * (1 + len(values) - len(fields))
    for k, value in enumerate(values, start=1):
        word, new = fields[k].strip(), repr(value).encode()
        fields[k] = fields[k].replace(word, new) if word else b" " + new
    return b",".join(fields) + end


_HEAD = re.compile(rb"\A(\s|\*\*.*\n)*\*[ \t]*(?!FLAC3D)[A-Za-z]")
ABAQUS_INP = Format("an input of Abaqus or CalculiX", (".inp",), _HEAD, _read, move=_move)

"""Files in OpenFOAM's format: a header with the encoding, then a list; ASCII or binary, optionally gzipped.

The header's ``arch`` has the width of labels and scalars of a binary file ("LSB;label=32;scalar=64").

https://www.openfoam.com/documentation/user-guide/2-openfoam-cases/2.2-basic-inputoutput-file-format
"""

from __future__ import annotations

import gzip
import io
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.packages import check_unpacked, most_unpacked
from mesh_motion_server.files.text import number_array, text_of

_T = TypeVar("_T", bound=np.generic)
_HEADER = re.compile(rb'FoamFile\s*\{((?:"[^"]*"|[^"}])*)\}')
_COMMENT = re.compile(rb"//[^\n]*|/\*.*?\*/", re.DOTALL)
_GAP = re.compile(rb"(?:\s+|//[^\n]*\n|/\*.*?\*/)*", re.DOTALL)
_COUNT = re.compile(rb"(\d{1,18})\s*")
_HEADER_TOKEN = re.compile(r'"[^"]*"|//[^\n]*|/\*.*?\*/|;|[^\s;"]+', re.DOTALL)
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}();]|[^\s{}();"]+')


@dataclass(frozen=True, eq=False)
class FoamFile:
    """One file."""

    path: Path  # the path, with ``.gz`` if compressed
    kind: str  # value of ``class`` in the header
    binary: bool
    #: label, scalar: types of labels and scalars in a binary file
    label: np.dtype[np.signedinteger]
    scalar: np.dtype[np.floating]
    header: bytes  # everything before the content
    body: bytes

    @classmethod
    def find(cls, folder: Path, name: str) -> FoamFile:
        """Read ``name`` or ``name.gz`` in a folder.

        Raises InvalidInput if there is no such file, or it has no valid header.
        """
        path = folder / name
        if not path.is_file():
            path = folder / f"{name}.gz"
        if not path.is_file():
            raise InvalidInput(
                f"{folder}: no file {name!r} or '{name}.gz'", hint="a polyMesh has points, faces, owner, …"
            )
        data = path.read_bytes()
        try:
            return cls._of(path, _unpacked(path, data) if path.suffix == ".gz" else data)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise InvalidInput(f"{path}: damaged gzip file: {error}") from None

    @classmethod
    def _of(cls, path: Path, data: bytes) -> FoamFile:
        found = _HEADER.search(data[:10_000])
        if found is None:
            raise InvalidInput(f"{path}: not an OpenFOAM file: it has no FoamFile header")
        entries = _entries(found[1].decode("latin-1"))
        arch = entries.get("arch", "")
        order = ">" if "MSB" in arch else "<"
        widths = dict(re.findall(r"(label|scalar)=(32|64)", arch))
        return cls(
            path=path,
            kind=entries.get("class", ""),
            binary=entries.get("format") == "binary",
            label=np.dtype(f"{order}i{int(widths.get('label', 32)) // 8}"),
            scalar=np.dtype(f"{order}f{int(widths.get('scalar', 64)) // 8}"),
            header=data[: found.end()],
            body=data[found.end() :],
        )

    def refused(self, reason: str) -> InvalidInput:
        """An error that names the file."""
        return InvalidInput(f"{self.path}: {reason}")

    def labels(self, *, at_most: int) -> Integers:
        """The content as a list of labels, at most ``at_most`` long."""
        if self.binary:
            return self._binary(0, self.label, 1, at_most)[0][:, 0].astype(np.int64)
        count, values, uniform = self._ascii()
        if count > at_most:
            raise self.refused(f"a list of {count} entries, but at most {at_most} are possible")
        found = self._numbers(values, np.int64)
        return self._counted(np.repeat(found, count) if uniform and len(found) == 1 else found, count)

    def vectors(self) -> Floats:
        """(n, 3) the content as a list of vectors."""
        if self.binary:
            return self._binary(0, self.scalar, 3, len(self.body))[0].astype(np.float64)
        count, values, _ = self._ascii()
        return self._counted(self._numbers(values, np.float64), 3 * count).reshape(count, 3)

    def write_vectors(self, values: Floats) -> None:
        """Replace the content by a list of vectors (n, 3), in the encoding of the file."""
        if self.binary:
            body = b"(" + values.astype(self.scalar).tobytes() + b")"
        else:
            rows = "\n".join(f"({x!r} {y!r} {z!r})" for x, y, z in values.tolist())
            body = f"(\n{rows}\n)".encode()
        content = b"%s\n\n%d\n%s\n" % (self.header, len(values), body)
        self.path.write_bytes(gzip.compress(content) if self.path.suffix == ".gz" else content)

    def faces(self) -> tuple[Integers, Integers]:
        """The content as faces: (f + 1,) start of each face's points, and the points of all faces."""
        if self.kind == "faceCompactList":
            return self._compact_faces()
        if self.binary:
            raise self.refused(f"expected class faceCompactList of a binary file, got {self.kind!r}")
        count, values, _ = self._ascii()
        if values.count(b"(") != count:
            raise self.refused(f"a list of {count} faces, but {values.count(b'(')} are written with their points")
        flat = self._numbers(values, np.int64)
        starts = np.empty(count + 1, dtype=np.int64)
        place, sizes = 0, flat.tolist()
        for face in range(count):
            starts[face] = place - face
            if place >= len(sizes) or not 3 <= sizes[place] < len(sizes) - place:
                raise self.refused(f"face {face} has no count of at least 3 points, or fewer points than it says")
            place += 1 + sizes[place]
        starts[count] = place - count
        if place != len(flat):
            raise self.refused(f"{len(flat) - place} numbers follow the last face")
        counts = starts[:-1] + np.arange(count)
        return starts, np.delete(flat, counts)

    def _compact_faces(self) -> tuple[Integers, Integers]:
        """Read two lists: the start of each face, and the points."""
        size = len(self.body)
        if self.binary:
            starts, end = self._binary(0, self.label, 1, size)
            nodes, _ = self._binary(end, self.label, 1, size)
            return self._checked_starts(starts[:, 0].astype(np.int64), nodes[:, 0].astype(np.int64))
        text = _COMMENT.sub(b"", self.body)
        lists = re.findall(rb"(\d{1,18})\s*\(([^()]*)\)", text)
        if len(lists) != 2:
            raise self.refused(f"expected two lists of labels, got {len(lists)}")
        first, second = (self._counted(self._numbers(values, np.int64), int(count)) for count, values in lists)
        return self._checked_starts(first, second)

    def _checked_starts(self, starts: Integers, nodes: Integers) -> tuple[Integers, Integers]:
        """Check that the two lists fit together."""
        short = np.flatnonzero(np.diff(starts) < 3)
        if not len(starts) or starts[0] != 0 or starts[-1] != len(nodes):
            raise self.refused(f"the faces' offsets do not run from 0 to {len(nodes)}, the number of their points")
        if len(short):
            raise self.refused(f"face {int(short[0])} has fewer than 3 points")
        return starts, nodes

    def _binary(
        self, start: int, dtype: np.dtype[np.generic], width: int, at_most: int
    ) -> tuple[NDArray[np.generic], int]:
        """(n, width) the binary list at or after ``start``, and its end."""
        gap = _GAP.match(self.body, start)
        found = _COUNT.match(self.body, gap.end() if gap else start)
        if found is None:
            raise self.refused("expected the number of entries of a list")
        count, place = int(found[1]), found.end()
        if count > at_most:
            raise self.refused(f"a list of {count} entries, but at most {at_most} are possible")
        if count == 0 and self.body[place : place + 1] != b"(":
            return np.empty((0, width), dtype=dtype), place
        end = place + 1 + count * width * dtype.itemsize
        if self.body[place : place + 1] != b"(" or self.body[end : end + 1] != b")":
            raise self.refused(
                f"a binary list of {count} entries of {width} × {dtype.itemsize} bytes does not end where it should: "
                f"the file is cut, or its header's 'arch' is wrong"
            )
        values = np.frombuffer(self.body, dtype, count * width, place + 1)
        return values.reshape(count, width), end + 1

    def _ascii(self) -> tuple[int, bytes, bool]:
        """The count of the list, the text between its brackets, and whether one value applies to all entries."""
        text = _COMMENT.sub(b"", self.body).strip()
        found = re.match(rb"(\d{1,18})\s*([({])", text)
        if found is None:
            raise self.refused("expected the number of entries of a list and '('")
        if not text.endswith(b")" if found[2] == b"(" else b"}"):
            raise self.refused("the list does not end: the file is cut")
        return int(found[1]), text[found.end() : -1], found[2] == b"{"

    def _numbers(self, text: bytes, dtype: type[_T]) -> NDArray[_T]:
        """All numbers of a text; brackets are ignored."""
        try:
            return number_array(text.translate(_BLANKS).split(), dtype)
        except (ValueError, OverflowError) as error:
            reason = str(error)
            raise self.refused(f"not a list of numbers: {reason[:70]}{'…' * (len(reason) > 70)}") from None

    def _counted(self, values: NDArray[_T], count: int) -> NDArray[_T]:
        """The values; refuse them if their number differs from the count of the list."""
        if len(values) != count:
            raise self.refused(f"{count} numbers were announced, {len(values)} follow")
        return values


def _unpacked(path: Path, data: bytes) -> bytes:
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        content = file.read(most_unpacked(len(data)) + 1)
    check_unpacked(path, len(data), len(content))
    return content


def _entries(text: str) -> dict[str, str]:
    """Keys and values of a header."""
    found: dict[str, str] = {}
    words: list[str] = []
    for token in _HEADER_TOKEN.findall(text):
        if token == ";" and words:
            found[words[0]] = " ".join(words[1:]).strip('"')
        if token == ";":
            words = []
        elif not token.startswith(("//", "/*")):
            words.append(token)
    return found


_BLANKS = bytes.maketrans(b"()", b"  ")


def dictionaries(file: FoamFile) -> list[tuple[str, dict[str, str]]]:
    """The named dictionaries of a list ``n ( name { key value; … } … )``, without nested dictionaries.

    The count ``n`` is optional. Raises InvalidInput if a bracket is missing.
    """
    tokens = iter(_TOKEN.findall(text_of(_COMMENT.sub(b"", file.body))))
    found: list[tuple[str, dict[str, str]]] = []
    first = next(tokens, "")
    if (next(tokens, "") if first.isdigit() else first) != "(":
        raise file.refused("expected the number of patches and '('")
    for name in tokens:
        if name == ")":
            return found
        if next(tokens, "") != "{":
            raise file.refused(f"expected '{{' after {name!r}")
        found.append((name.strip('"'), {}))
        depth, words = 1, list[str]()
        for token in tokens:
            depth += {"{": 1, "}": -1}.get(token, 0)
            if depth == 0:
                break
            if token == ";" and depth == 1 and words:
                found[-1][1][words[0]] = " ".join(words[1:])
            if token in ";{}":
                words = []
            else:
                words.append(token)
    raise file.refused("the list of patches does not end: the file is cut")

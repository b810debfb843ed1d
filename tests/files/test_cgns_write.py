"""CGNS files we write: names that meet, names it cannot hold, and coordinates that lie in other files."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files import MeshFile, check_target, read_mesh, write_mesh, write_moved

h5py = pytest.importorskip("h5py")

POINTS = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]], dtype=np.float64)
CELLS = {"quad": np.array([[0, 1, 4, 3], [1, 2, 5, 4]])}


def channel(*names: str) -> MeshFile:
    """Patches that each have an edge of the lower wall and a node on no edge of theirs."""
    line = {"line": np.array([[0, 1]])}
    return MeshFile(POINTS, CELLS, dict.fromkeys(names, np.array([0, 1, 5])), Path("made"), dict.fromkeys(names, line))


def cgnscheck(path: Path) -> list[str]:
    """What CGNS' own checker has against a file; a checker that does not get to its end says so with a line, too."""
    if shutil.which("cgnscheck") is None:
        pytest.skip("cgnscheck is not installed (Debian: cgns-convert)")
    done = subprocess.run(["cgnscheck", path.name], cwd=path.parent, capture_output=True, text=True, check=False)
    errors = [line.strip() for line in done.stdout.splitlines() if "ERROR" in line]
    whole = done.returncode == 0 and "checking complete" in done.stdout
    return errors if errors or whole else [f"status {done.returncode}: {done.stdout[-500:]} {done.stderr[-500:]}"]


TWINS = ("a patch with a long name: north", "a patch with a long name: south")


@pytest.mark.parametrize(
    "names",
    [("Zone",), ("Zone", "Zone 2"), TWINS, ("ä" * 16, "ä" * 15 + "o"), ("a", "a nodes"), ("a nodes", "a"),
     ("ZoneType", "quad", "ZoneBC", "Base", "GridCoordinates")],
)  # fmt: skip
def test_names_that_meet_are_told_apart(tmp_path: Path, names: tuple[str, ...]) -> None:
    mesh = channel(*names)
    write_mesh(tmp_path / "m.cgns", mesh)
    again = read_mesh(tmp_path / "m.cgns")
    assert set(again.patches) == set(names)
    for name in names:
        assert again.patches[name].tolist() == [0, 1, 5]
        assert again.facets[name]["line"].tolist() == [[0, 1]]
    assert cgnscheck(tmp_path / "m.cgns") == []


@pytest.mark.parametrize("name", ["", " ", " data", "a ", "a/b", ".", "..", "a\0b", "a" * 33, "ä" * 17])
def test_names_that_cgns_would_lose_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInput, match="is no name for a family of CGNS"):
        write_mesh(tmp_path / "m.cgns", channel(name))
    assert not list(tmp_path.iterdir())


def test_cgnscheck_accepts_all_solids_and_finds_what_is_wrong(
    tmp_path: Path, all_solids: tuple[np.ndarray, dict[str, np.ndarray]]
) -> None:
    path = tmp_path / "m.cgns"
    points, cells = all_solids
    write_mesh(path, MeshFile(points, cells, {"tip": np.array([8]), "low": np.array([0, 1, 2, 3])}, Path("made")))
    assert cgnscheck(path) == []
    with h5py.File(path, "r+") as file:
        file["Base/Zone/low quad/ElementRange/ data"][...] = [5, 7]
    assert cgnscheck(path)
    path.write_bytes(b"no CGNS")
    assert cgnscheck(path)


# --- coordinates that are in another file ---------------------------------------------------------------------------


GRID = "Base/Zone/GridCoordinates"


def linked(folder: Path, place: str, *, by_cgns: bool = False) -> Path:
    """A file whose node at ``place`` is a link to that of another file, ``whole.cgns``."""
    write_mesh(folder / "whole.cgns", channel("low"))
    shutil.copyfile(folder / "whole.cgns", folder / "linked.cgns")
    with h5py.File(folder / "linked.cgns", "r+") as file:
        label = file[place].attrs.get("label")
        del file[place]
        link = h5py.ExternalLink("whole.cgns", place)
        if not by_cgns:
            file[place] = link
            return folder / "linked.cgns"
        node = file.create_group(place)
        node.attrs["type"], node.attrs["label"] = np.bytes_(b"LK"), label
        node[" link"] = link
    return folder / "linked.cgns"


@pytest.mark.parametrize("by_cgns", [False, True])
@pytest.mark.parametrize("place", ["Base", "Base/Zone", GRID, f"{GRID}/CoordinateY"])
def test_moved_coordinates_never_go_into_a_file_that_nobody_named(tmp_path: Path, place: str, by_cgns: bool) -> None:
    path = linked(tmp_path, place, by_cgns=by_cgns)
    before = (tmp_path / "whole.cgns").read_bytes()
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, POINTS)
    with pytest.raises(InvalidInput, match=r"it lies in another file, .*whole\.cgns, which would be changed"):
        write_moved(tmp_path / "moved.cgns", mesh, mesh.points * 2)
    with pytest.raises(InvalidInput, match="which would be changed"):
        check_target(tmp_path / "moved.cgns", mesh)
    check_target(tmp_path / "moved.msh", mesh)
    assert (tmp_path / "whole.cgns").read_bytes() == before
    assert not (tmp_path / "moved.cgns").exists()


def virtual(file: h5py.Group, name: str) -> None:
    """An array whose values HDF5 takes from another file."""
    layout = h5py.VirtualLayout((len(POINTS),), "f8")
    layout[:] = h5py.VirtualSource("whole.cgns", name, (len(POINTS),))
    file.create_virtual_dataset(name, layout)


def raw(file: h5py.Group, name: str) -> None:
    """An array whose bytes lie in a file of their own."""
    POINTS[:, 0].tofile("whole.raw")
    file.create_dataset(name, (len(POINTS),), "f8", external=[("whole.raw", 0, POINTS[:, 0].nbytes)])


def by_link(file: h5py.Group, name: str) -> None:
    file[name] = h5py.ExternalLink("whole.cgns", name)


@pytest.mark.parametrize("kind", [virtual, raw, by_link])
def test_values_from_elsewhere_become_the_files_own(tmp_path: Path, kind, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_mesh(tmp_path / "whole.cgns", channel("low"))
    shutil.copyfile("whole.cgns", "m.cgns")
    name = f"{GRID}/CoordinateX/ data"
    with h5py.File("m.cgns", "r+") as file:
        del file[name]
        kind(file, name)
    before = {path: path.read_bytes() for path in tmp_path.glob("whole.*")}
    mesh = read_mesh(Path("m.cgns"))
    write_moved(Path("n.cgns"), mesh, mesh.points * 2)
    assert {path: path.read_bytes() for path in tmp_path.glob("whole.*")} == before
    np.testing.assert_array_equal(read_mesh(Path("n.cgns")).points, POINTS * 2)


@pytest.mark.parametrize("by_cgns", [False, True])
def test_a_link_to_nothing_names_where_it_leads(tmp_path: Path, by_cgns: bool) -> None:
    path = linked(tmp_path, GRID, by_cgns=by_cgns)
    (tmp_path / "whole.cgns").unlink()
    with pytest.raises(InvalidInput, match=r"a link to /?Base/Zone/GridCoordinates in whole\.cgns, which is not there"):
        read_mesh(path)

"""Display of the client's objects in a notebook; packages for it are loaded only when needed."""

import subprocess
import sys
import types

import numpy as np
import pytest
from matplotlib.figure import Figure
from mesh_motion_client import InvalidInput, Mesh, MeshMotionWarning, Patch, progress

UP = np.array([[0.0, 0.25]] * 4)
CUBE = Mesh(
    np.array([[x, y, z] for z in (0.0, 1.0, 2.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]),
    {"hexahedron": np.array([[0, 1, 3, 2, 4, 5, 7, 6], [4, 5, 7, 6, 8, 9, 11, 10]])},
    {"<low>": Patch("moving", np.arange(4))},
)


def test_a_mesh_says_its_size_box_and_patches():
    assert repr(CUBE).splitlines() == [
        "Mesh in 3D: 12 nodes, 2 hexahedron",
        "  box (0, 0, 0) to (1, 1, 2)",
        "  <low>: 4 nodes, moving",
    ]
    assert "&lt;low&gt;: 4 nodes" in CUBE._repr_html_()


def test_a_session_and_a_move_say_where_they_stand(session):
    moved = session.move(UP)
    step, quality, *others = repr(moved).splitlines()
    assert step.startswith("Moved: step 1, iteration 1, ")
    assert "; threshold " in quality
    assert others == ["  16 nodes, the farthest moves by 0.25", "  warning: a warning"]
    session.commit()
    first, second, *rest = repr(session).splitlines()
    assert first == f"Session {session.credentials.session[:8]}: step 1, no trial"
    assert second.startswith("  2D, 4 moving nodes: ")
    assert "support_radius 1.0" in second
    assert rest[0].startswith("  Mesh in 2D: 16 nodes")


def test_a_server_and_a_commit_say_what_they_are(client, session):
    first, second = repr(client).splitlines()
    assert first == f"Server {client.endpoint}: connected"
    assert second == f"  {client.welcome.server}, protocol 1.0, durability 'full' by default"
    session.move(UP)
    assert repr(session.commit()).splitlines() == [
        "Committed: step 1, durable",
        "  quality: minimum 1.000, 0 inverted cells",
    ]
    client.close()
    assert repr(client).splitlines()[0].endswith(": closed")


def test_a_warning_of_the_server_is_one_of_python(session):
    with pytest.warns(MeshMotionWarning, match="a warning"):
        moved = session.move(UP)
    assert moved.warnings == ["a warning"]


def test_pictures_are_figures_that_a_notebook_shows(session):
    moved = session.move(UP)
    session.commit()
    for figure in (session.plot(), moved.plot()):
        assert isinstance(figure, Figure)
        assert figure._repr_png_().startswith(b"\x89PNG")
    (drawn, *_) = moved.plot().axes
    middle = 0.25 + (moved.mesh.points[:, 1].min() + moved.mesh.points[:, 1].max()) / 2
    assert sum(drawn.get_ylim()) / 2 == pytest.approx(middle)


def test_a_move_or_session_that_cannot_be_drawn_is_refused_with_the_reason(client, session):
    with pytest.raises(InvalidInput, match="since the reference mesh"):
        session.move(UP, frame="committed").plot()
    session.close()
    with client.resume(session.credentials) as again, pytest.raises(InvalidInput, match="no cells to draw"):
        again.plot()


def test_of_a_mesh_in_space_the_boundary_is_drawn_by_pyvista_where_it_is(monkeypatch):
    monkeypatch.setattr("mesh_motion_client.display.find_spec", lambda name: None)
    still = Mesh(CUBE.points, CUBE.cells)
    assert len(still.plot().axes[0].collections[0].get_array()) == 10  # of two cubes the face between them is not drawn
    assert len(CUBE.plot().axes[0].collections[0].get_array()) == 1  # the moving patch
    given = {}

    class Plotter:
        def add_mesh(self, surface, **options):
            given.update(surface=surface, **options)

        def add_title(self, text, **options):
            given["title"] = text

    class Surface:
        def __init__(self, points, faces):
            self.points, self.faces, self.cell_data = points, faces, {}

    monkeypatch.setattr("mesh_motion_client.display.find_spec", lambda name: name == "pyvista" or None)
    monkeypatch.setitem(sys.modules, "pyvista", types.SimpleNamespace(Plotter=Plotter, PolyData=Surface))
    assert isinstance(still.plot(), Plotter)
    assert given["surface"].faces.reshape(10, 5)[:, 0].tolist() == [4] * 10
    assert given["surface"].cell_data["moved by"].tolist() == [0.0] * 10


def test_progress_goes_through_the_steps_whatever_is_installed(monkeypatch, capsys):
    asked = []
    tqdm = types.SimpleNamespace(tqdm=lambda steps, desc: asked.append(desc) or steps)
    monkeypatch.setitem(sys.modules, "tqdm.auto", tqdm)
    for installed in ({"tqdm"}, set()):
        monkeypatch.setattr("mesh_motion_client.display.find_spec", lambda name, there=installed: name in there or None)
        assert list(progress(range(1, 21), "flag")) == list(range(1, 21))
        said = capsys.readouterr().out
    assert asked == ["flag"]
    assert said == "".join(f"\rflag: {done} of 20" for done in range(1, 21)) + "\n"


def test_the_upload_and_the_build_are_shown_where_it_is_asked_for(client, mesh, monkeypatch, capsys):
    monkeypatch.setattr("mesh_motion_client.display.find_spec", lambda name: None)
    client.open(mesh, show_progress=True).close()
    parts = len(list(mesh.parts(session="", epoch=0)))
    assert f"\rmesh sent in parts, and built: {parts + 1} of {parts + 1}\n" in capsys.readouterr().out
    client.open(mesh).close()
    assert capsys.readouterr().out == ""


def test_nothing_is_loaded_before_it_is_drawn():
    script = "import sys, mesh_motion_client; print({'matplotlib', 'tqdm', 'pyvista', 'asyncio'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout == "set()\n"

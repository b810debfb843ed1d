"""The handling of a case and of replies by play: with a stand-in, and once with a real server."""

import csv
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
import pytest
from mesh_motion_client import InvalidInput as Refusal
from mesh_motion_client import Server
from mesh_motion_numerics.mesh.finite_volume import face_measures
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_protocol.errors import InvalidInput, QualityRefused, ResourceExhausted
from raising import raising

from mesh_motion_server import __version__
from mesh_motion_server.cases import play as play_module
from mesh_motion_server.cases import results as results_module
from mesh_motion_server.cases.case import Case, read_case
from mesh_motion_server.cases.faces import FACES, faces_line
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.cases.outputs import RESULTS
from mesh_motion_server.cases.play import play
from mesh_motion_server.files import MeshFile, read_mesh


class StandIn:
    """A session without a server: plain interpolation from the reference mesh; it refuses move ``refuse_at``."""

    def __init__(self, case: Case, mesh: MeshFile, refuse_at: int | None = None) -> None:
        roles = case.content.patches
        split = BoundaryRoles.from_patches({name: Patch(roles[name], nodes) for name, nodes in mesh.patches.items()})
        control = np.concatenate([split.moving, split.fixed])
        radius = case.content.method.support_radius
        assert radius is not None
        self.moving = len(split.moving)
        self.control = control
        self.matrix = wendland(mesh.points[control], mesh.points[control], radius)
        self.evaluate = wendland(mesh.points, mesh.points[control], radius)
        self.refuse_at = refuse_at
        self.moves: list[np.ndarray] = []
        self.reports: list[str] = []
        self.commits: list[int] = []
        self.mesh_report = {"warnings": ["odd mesh"]}
        self.settings: dict[str, Any] = case.content.method.model_dump()

    def move(self, displacement: np.ndarray, *, report: str = "") -> SimpleNamespace:
        self.moves.append(displacement)
        self.reports.append(report)
        if len(self.moves) == self.refuse_at:
            raise QualityRefused("no valid mesh was found", hint="take a smaller step")
        values = np.zeros((len(self.control), displacement.shape[1]))
        values[: self.moving] = displacement
        moved = self.evaluate @ np.linalg.solve(self.matrix, values)
        moved[self.control] = values
        seconds = {"solve": 1.0, "predict": 2.0, "correct": 3.0, "displace": 4.0, "total": 10.0}
        faces = {"before": faces_at(20.0), "after": faces_at(60.0 + len(self.moves))} if report else {}
        return SimpleNamespace(
            displacement=moved,
            quality={"corrected": {"metric": {"min": 0.5}}, "standard": {"metric": {"min": 0.25}}},
            enrichment_points=np.zeros((3, 2)),
            correction={"freed_nodes": 7, "sub_steps": 1},
            seconds=seconds,
            warnings=[f"warning {len(self.moves)}", "always"],
            faces=faces,
            headroom={"threshold": 1.25, "inversion": 9.0 / len(self.moves)} if report else {},
        )

    def commit(self, final_step: int) -> None:
        self.commits.append(len(self.moves))

    def status(self) -> SimpleNamespace:
        return SimpleNamespace(report={"peak_memory_bytes": 1 << 40})


def faces_at(angle: float) -> dict[str, Any]:
    worst = [{"cell": k, "centre": [0.5, 0.5], "non_orthogonality": angle - k} for k in range(10)]
    above = {"faces_above_65": int(angle > 65), "faces_above_75": 0}
    return {"faces": 40, "max_non_orthogonality": angle, "max_skewness": angle / 40, "min_volume_ratio": 0.5,
            "shortest_edge": 20.0 / angle, "smallest_face": 10.0 / angle, "worst": worst} | above  # fmt: skip


def wendland(a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    """(n, k) values of Wendland's C2 function."""
    x = np.linalg.norm(a[:, None] - b, axis=2) / radius
    return np.clip(1 - x, 0, None) ** 4 * (4 * x + 1)


def opener(sessions: list[StandIn], refuse_at: int | None = None) -> Any:
    """A replacement of ``open_session``; its sessions go to a list."""

    @contextmanager
    def open_stand_in(case: Case, mesh: MeshFile, *options: Any, **more: Any) -> Iterator[StandIn]:
        sessions.append(StandIn(case, mesh, refuse_at))
        yield sessions[-1]

    return open_stand_in


Plays = Callable[..., list[StandIn]]


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> Plays:
    """Replace the server; return the list of the sessions that were opened."""

    def use(refuse_at: int | None = None) -> list[StandIn]:
        sessions: list[StandIn] = []
        monkeypatch.setattr(play_module, "open_session", opener(sessions, refuse_at))
        return sessions

    return use


def results(folder: Path) -> list[str]:
    return sorted(f.name for pattern in RESULTS for f in folder.glob(pattern))


def test_all_results_and_every_promised_key(make_case, stand_in: Plays, tmp_path: Path) -> None:
    stand_in()
    case = make_case()
    played = play(case, tmp_path / "out" / "deep")
    folder = tmp_path / "out" / "deep"
    assert sorted(f.name for f in folder.iterdir()) == results(folder)
    assert results(folder) == [
        "mesh.pvd",
        "mesh_0000.vtu",
        "mesh_0001.vtu",
        "mesh_0002.vtu",
        "points.npy",
        "quality.png",
        "steps.csv",
        "summary.json",
    ]
    summary = json.loads((folder / "summary.json").read_text())
    for key in ("steps", "boundary_error", "peak_memory_bytes", "method", "version"):
        assert key in summary
    for key in (
        "step", "min_size", "min_skew", "min_size_skew", "mean_size_skew", "inverted_cells", "predicted_min",
        "enrichment_points", "seconds", "seconds_solve", "seconds_predict", "seconds_correct", "seconds_displace",
    ):  # fmt: skip
        assert [key in step for step in summary["steps"]] == [True, True]
    assert summary["version"] == __version__
    assert summary["method"]["correction"] == "none"
    assert summary["peak_memory_bytes"] > 1 << 40
    assert summary["warnings"] == ["odd mesh", "warning 1", "always", "warning 2"]
    assert played.summary == summary
    rows = list(csv.DictReader((folder / "steps.csv").read_text().splitlines()))
    assert [float(row["min_size_skew"]) for row in rows] == [step["min_size_skew"] for step in summary["steps"]]


def test_each_step_has_its_faces_in_the_solvers_words(make_case, stand_in: Plays, tmp_path: Path) -> None:
    sessions = stand_in()
    played = play(make_case(("count = 2", "count = 2\niterations = 3")), tmp_path / "out")
    assert sessions[0].reports == ["", "", "faces"] * 2  # of the Move that is committed
    steps = json.loads((tmp_path / "out" / "summary.json").read_text())["steps"]
    for step, angle in zip(steps, (63.0, 66.0), strict=True):
        assert step["faces"]["before"]["max_non_orthogonality"] == 20.0
        assert step["faces"]["after"]["max_non_orthogonality"] == angle
        assert "worst" not in step["faces"]["before"]
        assert [face["non_orthogonality"] for face in step["faces"]["after"]["worst"]] == [angle]
    rows = list(csv.DictReader((tmp_path / "out" / "steps.csv").read_text().splitlines()))
    assert list(rows[0])[-len(FACES) :] == list(FACES)
    assert [(float(row["max_non_orthogonality"]), int(row["faces_above_65"])) for row in rows] == [(63, 0), (66, 1)]
    ahead = [(float(row["headroom_threshold"]), float(row["headroom_inversion"])) for row in rows]
    assert faces_line([step.faces for step in played.steps]) == (
        "non-orthogonality at most 66.0° in step 2 (20.0° at rest), 1 face above 65°; skewness at most 1.65 (0.50), "
        "volume ratio at least 0.50 (0.50); shortest edge 0.3, smallest face 0.15 of that at rest"
    )
    assert ahead == [(1.25, 3.0), (1.25, 1.5)]
    last = played.steps[-1]
    assert last.ahead == "more steps like the last one: 1.2 to the quality threshold, 1.5 to the first inverted cell"
    assert replace(last, headroom_threshold=3.1, headroom_inversion=None).ahead == ""


def test_of_a_run_without_faces_there_is_no_line() -> None:
    assert faces_line([{}, {}]) == ""


def test_points_and_quality_are_those_of_the_last_step(make_case, stand_in: Plays, tmp_path: Path) -> None:
    stand_in()
    case_file = make_case()
    play(case_file, tmp_path / "out")
    mesh, points = read_mesh(case_file.parent / "mesh.npz"), np.load(tmp_path / "out" / "points.npy")
    program = MotionProgram.of(read_case(case_file), mesh)
    np.testing.assert_allclose(points[program.nodes], mesh.points[program.nodes] + program.displacement(2), atol=1e-15)
    quality = cell_quality(points, mesh.cell_table, reference_sizes(mesh.points, mesh.cell_table))
    last = json.loads((tmp_path / "out" / "summary.json").read_text())["steps"][-1]
    assert last["min_size"] == quality.size.min()
    assert last["min_skew"] == quality.skew.min()
    assert last["min_size_skew"] == (np.sqrt(np.abs(quality.size)) * np.sign(quality.size) * quality.skew).min()
    assert last["inverted_cells"] == 0


def test_iterations_approach_the_step_from_its_committed_state(make_case, stand_in: Plays, tmp_path: Path) -> None:
    sessions = stand_in()
    case_file = make_case(("count = 2", "count = 2\niterations = 3"))
    played = play(case_file, tmp_path / "out")
    [session] = sessions
    mesh = read_mesh(case_file.parent / "mesh.npz")
    program = MotionProgram.of(read_case(case_file), mesh)
    one, two = program.displacement(1), program.displacement(2)
    expected = [0.5 * one, 0.75 * one, one, one + 0.5 * (two - one), one + 0.75 * (two - one), two]
    for move, wanted in zip(session.moves, expected, strict=True):
        np.testing.assert_allclose(move, wanted, atol=1e-16)
    assert session.commits == [3, 6]
    np.testing.assert_array_equal(session.moves[2], one)  # the committed one is exact
    assert played.steps[0].iterations == 3
    assert played.steps[0].seconds_correct == 9.0  # all iterations together


def test_every_writes_fewer_files_but_always_the_last_step(make_case, stand_in: Plays, tmp_path: Path) -> None:
    stand_in()
    play(make_case(("count = 2", "count = 5")), tmp_path / "out", every=3)
    text = (tmp_path / "out" / "mesh.pvd").read_text()
    assert [float(part.split('"')[1]) for part in text.split("timestep=")[1:]] == [0.0, 3.0, 5.0]


def test_a_refused_step_keeps_the_steps_before_it(make_case, stand_in: Plays, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stand_in()
    play(make_case(), out)
    (out / "notes.txt").write_text("mine")
    stand_in(refuse_at=2)
    with pytest.raises(QualityRefused) as refused:
        play(make_case(), out)
    found = {f.name for f in out.iterdir()}
    # results of the first run are removed, and the last accepted mesh is not stored as the final one
    assert "points.npy" not in found
    assert {"notes.txt", "accepted.npy", "refused.vtu", "mesh_0000.vtu", "mesh_0001.vtu", "quality.png"} <= found
    assert "mesh_0002.vtu" not in found
    summary = json.loads((out / "summary.json").read_text())
    ended, mesh = summary["ended_early"], read_mesh(make_case().parent / "mesh.npz")
    assert [step["step"] for step in summary["steps"]] == [1]
    assert (ended["step"], ended["code"], len(ended["worst"])) == (2, "FAILED_PRECONDITION.QUALITY", 10)
    grid = meshio.read(out / "refused.vtu")
    assert int(grid.cell_data["worst"][0].sum()) == 10
    assert grid.cell_data["cell"][0].ravel().tolist() == list(range(len(grid.cells[0].data)))
    series = read_mesh(out / "mesh_0001.vtu")
    assert {name: nodes.tolist() for name, nodes in series.patches.items()} == {
        name: nodes.tolist() for name, nodes in mesh.patches.items()
    }
    worst = ended["worst"][0]
    triangle = grid.cells[0].data[worst["cell"]]
    np.testing.assert_allclose(grid.points[triangle][:, :2].mean(axis=0), worst["centre"])
    near = ", ".join(f"{x:.4g}" for x in worst["centre"])
    assert refused.value.message == (
        f"step 2 of 2: no valid mesh was found; the worst cell is triangle {worst['cell']} near ({near})"
    )
    assert refused.value.__notes__ == [f"1 of 2 steps are kept in {out}"]
    accepted = np.load(out / "accepted.npy")
    first = MotionProgram.of(read_case(make_case()), mesh)
    np.testing.assert_allclose(accepted[first.nodes], mesh.points[first.nodes] + first.displacement(1), atol=1e-12)


def test_a_refusal_of_the_first_step_can_be_looked_at(make_case, stand_in: Plays, tmp_path: Path) -> None:
    stand_in(refuse_at=1)
    with pytest.raises(QualityRefused):
        play(make_case(), tmp_path / "new")
    names = {f.name for f in (tmp_path / "new").iterdir()}
    assert {"refused.vtu", "quality.png", "summary.json", "mesh_0000.vtu"} <= names
    assert not names & {"points.npy", "accepted.npy"}


def test_an_invalid_case_takes_old_results_away_and_makes_no_folder(make_case, stand_in: Plays, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stand_in()
    play(make_case(), out)
    with pytest.raises(InvalidInput):
        play(make_case(("0.6", "-1")), out)
    assert results(out) == []
    with pytest.raises(InvalidInput):
        play(make_case(("0.6", "-1")), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_misspelt_case_file_costs_no_old_results(make_case, stand_in: Plays, tmp_path: Path) -> None:
    stand_in()
    play(make_case(), tmp_path / "out")
    before = results(tmp_path / "out")
    with pytest.raises(InvalidInput, match=r"cass\.toml: the case file cannot be read"):
        play(tmp_path / "cass.toml", tmp_path / "out")
    assert results(tmp_path / "out") == before != []


def test_an_interrupt_before_the_first_step_leaves_nothing(
    make_case, stand_in: Plays, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in()
    monkeypatch.setattr(StandIn, "move", raising(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        play(make_case(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_file_in_the_place_of_the_folder_is_refused(make_case, stand_in: Plays, tmp_path: Path) -> None:
    stand_in()
    (tmp_path / "out").write_text("a file")
    with pytest.raises(ResourceExhausted, match="results cannot be written there"):
        play(make_case(), tmp_path / "out")
    assert (tmp_path / "out").read_text() == "a file"


def test_without_matplotlib_all_but_the_picture(
    make_case, stand_in: Plays, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in()
    for module in (play_module, results_module):
        monkeypatch.setattr(module, "pictures_are_possible", lambda: False)
    played = play(make_case(), tmp_path / "out")
    assert not (tmp_path / "out" / "quality.png").exists()
    assert (tmp_path / "out" / "points.npy").exists()
    assert any("mesh-motion-server[plot]" in warning for warning in played.warnings)


# --- over the wire ---------------------------------------------------------------------------------------------------


def nothing_is_left(server: Server, name: str) -> bool:
    """Wait until no session is left of the case: a discarded one leaves the list with CLOSED."""
    deadline = time.monotonic() + 20.0
    while (left := [entry for entry in server.sessions() if entry["label"] == name]) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not left


def test_a_case_through_a_real_server(make_case, server: Server, tmp_path: Path) -> None:
    case_file = make_case(
        ("count = 2", "count = 3\niterations = 2"),
        ('"none"', '"optimised"\nquality_metric = "size-skew"\nquality_threshold = 0.5'),
    )
    played = play(case_file, tmp_path / "out", endpoint=server.endpoint)
    summary = played.summary
    assert summary["boundary_error"] <= 1e-12
    assert summary["inverted_cells"] == 0
    assert summary["method"]["basis"] == "wendland-c2"  # defaults are filled in
    assert summary["peak_memory_bytes"] > 50 << 20  # two processes with numpy
    for step in played.steps:
        assert step.predicted_min == pytest.approx(step.min_size_skew, rel=1e-9)
        assert step.seconds > 0
    for name, points in (("before", played.mesh.points), ("after", played.points)):
        measured = face_measures(points, played.mesh.cell_table, played.mesh.points)
        written = {key: value for key, value in played.steps[-1].faces[name].items() if key != "worst"}
        assert written == pytest.approx(measured.numbers(), rel=1e-9)
    assert nothing_is_left(server, read_case(case_file).name)
    again = play(case_file, tmp_path / "again", endpoint=server.endpoint)
    np.testing.assert_array_equal(again.points, played.points)


def test_a_refused_motion_leaves_no_final_mesh_and_no_session(make_case, server: Server, tmp_path: Path) -> None:
    out = tmp_path / "out"
    through_the_wall = make_case(("[0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5]", "[0.9, 0.0]"))
    with pytest.raises(QualityRefused) as refused:
        play(through_the_wall, out, endpoint=server.endpoint)
    assert "\n" not in str(refused.value)
    assert not (out / "points.npy").exists()
    strict = ('"none"', '"none"\nquality_threshold = 0.999\nrefuse_below_threshold = true')
    with pytest.raises(QualityRefused):
        play(make_case(strict), out, endpoint=server.endpoint)
    with pytest.raises(Refusal, match="'gauss' needs a shape parameter"):
        play(make_case(("support_radius = 0.6", 'basis = "gauss"')), out, endpoint=server.endpoint)
    assert not out.exists() or results(out) == []
    assert nothing_is_left(server, read_case(through_the_wall).name)


def test_a_valid_motion_below_the_threshold_is_kept_with_a_warning(make_case, server: Server, tmp_path: Path) -> None:
    played = play(make_case(('"none"', '"none"\nquality_threshold = 0.99')), tmp_path / "out", endpoint=server.endpoint)
    assert played.warnings
    assert (tmp_path / "out" / "points.npy").exists()

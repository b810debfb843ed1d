"""Reading of a deck, and cards that a deck may not contain; the window's deck and the columns of ccx. Needs no
CalculiX.
"""

import numpy as np
import pytest
from mesh_motion_calculix import DeckError, DivergedError, Options, RunError, flap_deck, read_deck
from mesh_motion_calculix.window import read_motion, window_deck


@pytest.fixture
def written(tmp_path):
    def write(text, name="model.inp"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def test_nodes_sets_ranges_and_includes(written):
    written("3, 0.5, 1.0D-1\n9, 1., 2., 3.\n", "more.inp")
    deck = read_deck(
        written(
            "** comment\n*node, nset = all\n 1, 0., 1.\n*INCLUDE, INPUT=more.inp\n*NSET,NSET=a\n1, 3\n"
            "*NSET, NSET=B, GENERATE\n1, 9, 2\n*NSET, NSET=C\nA, 9\n"
        )
    )
    np.testing.assert_array_equal(deck.points[3], [0.5, 0.1, 0.0])
    assert deck.node_set("All").tolist() == [1, 3, 9]
    assert deck.node_set("c").tolist() == [1, 3, 9]
    assert deck.sets["B"].tolist() == [1, 3, 5, 7, 9]
    with pytest.raises(DeckError, match="node 5 of set B is not defined"):
        deck.node_set("b")
    with pytest.raises(DeckError, match=r"no node set WET with nodes in it .its sets: A, ALL, B, C"):
        deck.node_set("wet")
    assert not any(line.startswith(("**", "*INCLUDE")) for line in deck.lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("*NODE\n1, 0.\n*STEP\n", "has a .STEP card .*the adapter writes the steps"),
        ("*RESTART, READ\n", "has a .RESTART card"),
        ("*ELEMENT, TYPE=C3D8\n", "no .NODE card"),
        ("*NODE\n1, zero\n", "card .NODE: could not convert"),
        ("*NODE\n1, 0.\n*NSET\n1\n", "card .NSET: it has no NSET=name"),
        ("*NODE\n1, 0.\n*NSET, NSET=A\nOTHER\n", "OTHER is neither a node number nor a set"),
        ("*INCLUDE, INPUT=gone.inp\n", "gone.inp cannot be read"),
        ("*INCLUDE, INPUT=model.inp\n", "files deep"),
    ],
)
def test_decks_that_cannot_be_used(written, text, message):
    with pytest.raises(DeckError, match=message):
        read_deck(written(text))


def test_flap_is_clamped_at_its_foot_and_wet_elsewhere(written):
    deck = read_deck(written(flap_deck((2, 4))))
    points = np.array([deck.points[int(node)] for node in deck.node_set("interface")])
    assert len(deck.points) == 2 * 3 * 5
    assert (np.isclose(np.abs(points[:, 0]), 0.05) | np.isclose(points[:, 1], 1.0)).all()
    assert len(deck.node_set("FOOT")) == len(deck.node_set("TIP")) == 6
    with pytest.raises(DeckError, match="positive"):
        flap_deck((0, 4))


def test_every_number_of_a_window_fits_the_fields_of_calculix():
    forces = [(7, np.array([-1.0 / 3.0, -1e-99])), (8, np.array([0.0, -1.2345678901234e200]))]
    deck = window_deck(None, "WET", forces, 1.0 / 3.0, Options(alpha=-0.05)).splitlines()
    assert deck[0] == "*RESTART, READ"
    loads = deck[deck.index("*CLOAD") + 1 : deck.index("*NODE PRINT, NSET=WET")]
    assert loads[0] == "7, 1, -3.333333333333e-01"
    assert len(loads) == 4
    assert max(len(field) for line in loads for field in line.split(", ")) <= 20


def test_columns_of_results_are_read_whatever_stands_in_them(tmp_path):
    row = "         4 -1.500000-101-3.355378E-09  2.000000E+00\n"
    blocks = "\n {} (vx,vy,vz) for set WET and time  0.1E-01\n\n{}"
    path = tmp_path / "window.dat"
    path.write_text(blocks.format("displacements", row) + blocks.format("velocities", row))
    motion = read_motion(path, np.array([4]))
    np.testing.assert_array_equal(motion.velocities, [[-1.5e-101, -3.355378e-09, 2.0]])
    with pytest.raises(RunError, match="every node of the interface"):
        read_motion(path, np.array([4, 5]))
    path.write_text(path.read_text().replace(" 2.000000E+00", "          NaN"))
    with pytest.raises(DivergedError, match="node 4 is not finite"):
        read_motion(path, np.array([4]))

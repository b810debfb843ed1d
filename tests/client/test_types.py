"""The types of settings and quality are those of the server: neither can change without the other."""

from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
from mesh_motion_client import Mesh, Patch, Settings, connect
from mesh_motion_client.quality import Distribution, PredictedQuality, QualitySummary, WorstCell
from mesh_motion_numerics.method import KEYS

SQUARE = Mesh(
    np.array([[x, y] for y in (0.0, 1.0, 2.0) for x in (0.0, 1.0, 2.0)]),
    {"quad": [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]},
    {"low": Patch("moving", [0, 1, 2]), "high": Patch("fixed", [6, 7, 8])},
)


def test_the_settings_are_the_keys_of_the_method():
    hints = get_type_hints(Settings)
    assert list(hints) == list(KEYS)
    for name, key in KEYS.items():
        kinds = set(get_args(hints[name])) if type(None) in get_args(hints[name]) else {hints[name]}
        assert (type(None) in kinds) == (key.default is None), name
        (kind,) = kinds - {type(None)}
        assert (get_args(kind) if get_origin(kind) is Literal else kind) == (key.choices or key.kind), name


def test_the_quality_is_what_a_server_reports():
    with connect() as server, server.open(SQUARE) as session:
        first, again = (session.move(np.full((3, 2), far)).quality for far in (0.25, 0.5))
        for summary in (session.quality, first["corrected"], session.commit().quality):
            assert set(summary) == set(QualitySummary.__annotations__)
            assert set(summary["metric"]) == set(Distribution.__annotations__)
            assert set(summary["worst"][0]) == set(WorstCell.__annotations__)
        assert set(first) == set(PredictedQuality.__annotations__)
        assert set(again["corrected"]) == QualitySummary.__required_keys__
        assert set(again["corrected"]["metric"]) == Distribution.__required_keys__
        assert set(session.settings) == set(KEYS)

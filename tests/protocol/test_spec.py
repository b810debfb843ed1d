"""SPEC.md agrees with the code: its tables, its codes, its example bytes."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from loaded_scripts import loaded
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.digests import STATE_PREFIX
from mesh_motion_protocol.errors import ERROR_CODES
from mesh_motion_protocol.limits import LIMITS
from mesh_motion_protocol.messages import MESSAGES, Move, Ping

from mesh_motion_server.settings import ServerSettings

ROOT = Path(__file__).resolve().parents[2]
SPEC = ROOT / "protocol" / "SPEC.md"


@pytest.fixture(scope="module")
def render():
    return loaded(ROOT / "protocol" / "render_spec.py")


@pytest.fixture(scope="module")
def text():
    return SPEC.read_text(encoding="utf-8")


def test_the_tables_are_those_of_the_code(render, text):
    assert render.rendered(text) == text
    assert set(re.findall(r"<!-- table: (\S+) -->", text)) == set(render.tables())


def test_every_field_has_a_meaning(render):
    for cls in MESSAGES.values():
        meanings = render._meanings(cls)
        for field in dataclasses.fields(cls):
            assert field.name in ("client", "sequence") or meanings[field.name], (cls.type, field.name)


def test_codes_in_the_text_exist(text):
    heads = {code.partition(".")[0] for code in ERROR_CODES}
    mentioned = {match for match in re.findall(r"\b([A-Z_]{5,}\.[A-Z_]+)\b", text) if match.partition(".")[0] in heads}
    assert mentioned <= set(ERROR_CODES)


def test_limits_in_the_text_exist(text):
    mentioned = set(re.findall(r"`((?:max|stored)_\w+|\w+_ms)`", text))
    others = {"max_enrichment_points", "max_non_orthogonality", "max_skewness"}
    others.add("compute_limit_ms")
    assert mentioned - others <= set(LIMITS)
    assert set(LIMITS) <= mentioned


def test_the_server_announces_limits_of_the_table_with_its_values():
    ours = ServerSettings().limits()
    assert set(ours) <= set(LIMITS)
    assert {name: min(value, LIMITS[name].value) for name, value in ours.items()} == {
        name: LIMITS[name].value for name in ours
    }


def test_codes_in_the_server_exist():
    found = set()
    for path in [*(ROOT / "mesh_motion_server").rglob("*.py"), *(ROOT / "adapters" / "python").rglob("*.py")]:
        found |= set(re.findall(r'code\s*=\s*"([A-Z_.]+)"', path.read_text(encoding="utf-8")))
    assert found
    assert found <= set(ERROR_CODES)


def shown_bytes(text, title):
    block = text.partition(title)[2].split("```")[1]
    rows = (re.match(r"\s*((?:[0-9a-f]{2}\s+)+)", line + " ") for line in block.splitlines())
    return bytes.fromhex("".join(match[1] for match in rows if match))


def test_the_bytes_of_ping_in_the_text(text):
    shown = shown_bytes(text, "is one frame of 65 bytes:")
    assert [shown] == encode(Ping(client=bytes(range(16)), sequence=7))
    assert len(shown) == 65


def test_the_bytes_of_move_in_the_text(text):
    header, array = shown_bytes(text, "The first has 174 bytes:"), shown_bytes(text, "and the second 32")
    assert (len(header), len(array)) == (174, 32)
    shown = decode([header, array])
    assert isinstance(shown, Move)
    assert (shown.client, shown.sequence, shown.step, shown.frame) == (bytes(range(16)), 8, 1, "reference")
    np.testing.assert_array_equal(shown.displacement, [[0.0, 0.5], [0.0, 1.0]])


def test_the_prefix_of_the_digest_is_twenty_bytes():
    assert STATE_PREFIX == b"mesh-motion state 1\n"
    assert len(STATE_PREFIX) == 20

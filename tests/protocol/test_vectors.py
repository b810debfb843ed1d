"""The golden vectors: bit-exact, complete, and in agreement with their descriptions."""

import pytest
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ERROR_CODES, ProtocolError
from mesh_motion_protocol.messages import MESSAGES
from mesh_motion_protocol.vectors import load
from mesh_motion_protocol.vectors.generate import invalid_cases, plain_message, render, valid_cases

VALID, INVALID = load("valid"), load("invalid")


def frames_of(case):
    return [bytes.fromhex(frame) for frame in case["frames"]]


def ids(cases):
    return [case["name"] for case in cases]


def test_the_files_are_what_the_generator_writes():
    assert render(valid_cases()) == render(VALID)
    assert render(invalid_cases()) == render(INVALID)


def test_every_message_type_has_a_canonical_vector():
    assert {case["message"]["type"] for case in VALID if case["canonical"]} == set(MESSAGES)


def test_names_are_unique_and_codes_known():
    for cases in (VALID, INVALID):
        assert len(set(ids(cases))) == len(cases)
    assert {case["error"] for case in INVALID} <= set(ERROR_CODES)


@pytest.mark.parametrize("case", VALID, ids=ids(VALID))
def test_valid(case):
    message = decode(frames_of(case))
    assert plain_message(message) == case["message"]
    if case["canonical"]:
        assert [bytes(frame) for frame in encode(message)] == frames_of(case)


@pytest.mark.parametrize("case", INVALID, ids=ids(INVALID))
def test_invalid(case):
    with pytest.raises(ProtocolError) as caught:
        decode(frames_of(case))
    assert caught.value.code == case["error"]

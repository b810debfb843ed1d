"""Replies on their way out."""

import json
from types import SimpleNamespace

import pytest
from mesh_motion_protocol.codec import decode
from mesh_motion_protocol.messages import Listed, Pong, Welcome

from mesh_motion_server.transport.gateway import Gateway
from mesh_motion_server.transport.registry import fit
from mesh_motion_server.transport.replies import encoded

IDENTITY = {"client": b"c" * 16, "sequence": 7}
TOO_LARGE = Listed(**IDENTITY, sessions=[{"label": "x" * 70_000}])


def test_a_reply_that_cannot_be_encoded_becomes_an_error():
    (frame,) = encoded(TOO_LARGE, state="READY")
    error = decode([bytes(frame)])
    assert (error.code, error.client, error.sequence, error.state) == ("INTERNAL", b"c" * 16, 7, "READY")
    assert "the header must be at most 65536 bytes" in error.message
    assert decode(encoded(Pong(**IDENTITY))).type == "PONG"


def test_the_gateway_goes_on_after_a_reply_that_cannot_be_encoded():
    sent = []
    socket = SimpleNamespace(send_multipart=lambda frames, flags: sent.append(decode(frames[1:])))
    welcome = {"server": "s" * 70_000, "boot": b"b" * 16, "limits": {}, "durability": ["full"]}
    gateway = Gateway(None, socket, welcome)
    gateway._reply(b"peer", Welcome(**IDENTITY, version=[1, 0], features=[], **welcome))
    gateway._reply(b"peer", Pong(**IDENTITY))
    assert [(m.type, m.sequence) for m in sent] == [("ERROR", 7), ("PONG", 7)]
    assert sent[0].code == "INTERNAL"


@pytest.mark.parametrize("characters", [0, 100, 200])
def test_as_many_sessions_as_fit(characters):
    entries = [{"session": "0" * 32, "label": "\N{GREEK SMALL LETTER PI}" * characters} for _ in range(200)]
    fitting = fit(entries)
    assert decode(encoded(Listed(**IDENTITY, sessions=fitting))).type == "LISTED"
    assert len(fitting) == 200 or len(json.dumps(fitting, ensure_ascii=False).encode()) > 50_000

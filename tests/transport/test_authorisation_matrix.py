"""Every role, every request, an own session and another's: over real sockets with real keys."""

import numpy as np
import pytest
from mesh_motion_protocol import messages as m
from mesh_motion_protocol.messages import REPLIES

from mesh_motion_server.security.authorisation import MATRIX, NO_SESSION, Role, Verdict, decide
from mesh_motion_server.security.key_folder import admit, make_server_keys, revoke

ROWS = np.zeros((2, 2))
FIELDS = {
    "OPEN": {"dimension": 2},
    "UPLOAD": {"item": "nodes", "rows": ROWS},
    "MOVE": {"step": 1, "frame": "reference", "displacement": ROWS},
    "JUDGE": {"step": 1, "part": {}, "questions": [], "bins": ROWS.astype(int), "values": ROWS, "worst": ROWS},
    "CORRECT": {
        "step": 1,
        "part": {},
        "nodes": ROWS.astype(int),
        "points": ROWS,
        "positions": ROWS,
        "corners": np.arange(3)[:, None],
    },
    "COMMIT": {"step": 1},
    "ROLLBACK": {"step": 1},
}
CELLS = [(role, request, own) for role in Role for request in REPLIES for own in (True, False)]


@pytest.fixture(scope="module")
def keyed(make_module_server, tmp_path_factory, make_keys):
    """A server with keys, one user whose roles the tests change, and another one who owns a session."""
    folder = tmp_path_factory.mktemp("keys")
    make_server_keys(folder)
    server = make_module_server(keys_folder=str(folder))
    server.keys, server.sessions = folder, {}
    server.subject, server.other = make_keys("subject", folder), make_keys("other", folder)
    return server


@pytest.fixture
def session_of(keyed, connect):
    """The session of the subject (True) or of the other one, with the epoch in force; made again when it was closed."""

    def session_of(own):
        for name, keys in (("subject", keyed.subject), ("other", keyed.other)):
            admit(keys.public, keyed.keys, name=name, roles=["owner"])
        control = connect(keyed.endpoint, keyed.subject if own else keyed.other)
        known = keyed.sessions.get(own)
        if known is not None:
            probed = control.ask(m.Probe, session=known.session, token=known.token)
            if probed.worker == "alive":
                return known, probed.epoch
        keyed.sessions[own] = control.ask(m.Open, dimension=2)
        return keyed.sessions[own], 1

    return session_of


@pytest.fixture
def asked(keyed, connect, session_of):
    """What becomes of a request: the reply's type, or the error's code."""

    def ask(roles, request, own):
        opened, epoch = session_of(own)
        control, data = connect(keyed.endpoint, keyed.subject), connect(opened.endpoint, keyed.subject)
        at = {"session": opened.session, "epoch": epoch, "token": opened.token}
        for connection in (control, data):  # a handshake that is not over when the key goes is never answered
            assert connection.ask(m.Ping).type == "PONG"
        if roles:
            admit(keyed.subject.public, keyed.keys, name="subject", roles=roles)
        else:
            revoke("subject", keyed.keys)
        cls = m.MESSAGES[request]
        fields = {k: v for k, v in at.items() if k in cls.__dataclass_fields__} | FIELDS.get(request, {})
        if decide(roles, request, own=own) is Verdict.OVERSEE and "token" in fields:
            fields["token"] = b"x" * 32  # not needed
        reply = (control if request in m.CONTROL else data).ask(cls, **fields)
        if reply.type == "CLOSED":
            keyed.sessions.pop(own)
        if reply.type == "LISTED":
            listed = [entry["session"] for entry in reply.sessions]
            return "LISTED" if opened.session in listed else "NOT_FOUND"
        return reply.code if reply.type == "ERROR" else reply.type

    return ask


def allowed(request, outcome):
    """The request was taken: answered, or refused by the session itself for what it says."""
    return outcome in (REPLIES[request], "FAILED_PRECONDITION.STATE")


@pytest.mark.parametrize(("role", "request_type", "own"), CELLS)
def test_every_cell(asked, role, request_type, own):
    verdict = MATRIX[role][request_type][not own]
    outcome = asked([role.value], request_type, own)
    if verdict in (Verdict.USE, Verdict.OVERSEE):
        assert allowed(request_type, outcome), outcome
    else:
        assert outcome == verdict.value


@pytest.mark.parametrize("request_type", sorted(REPLIES))
def test_a_key_that_is_taken_off_the_list_has_no_rights_on_its_open_connections(asked, request_type):
    assert asked([], request_type, True) == "UNAUTHENTICATED"


def test_the_table_is_whole():
    assert set(MATRIX) == set(Role)
    for cells in MATRIX.values():
        assert set(cells) == set(REPLIES)
        assert all(cells[request][0] is cells[request][1] for request in NO_SESSION)


def test_no_array_comes_or_goes_without_ownership():
    with_arrays = {"JOIN", "UPLOAD", "BUILD", "MOVE", "JUDGE", "CORRECT", "COMMIT", "ROLLBACK", "FETCH"}
    for role in (Role.MONITOR, Role.ADMIN):
        assert all(cell is Verdict.DENIED for request in with_arrays for cell in MATRIX[role][request])
    assert all(MATRIX[Role.OWNER][request][1] is Verdict.HIDDEN for request in set(REPLIES) - NO_SESSION)


def test_of_several_roles_each_request_has_the_best():
    both = ["owner", "monitor"]
    assert decide(both, "STATUS", own=True) is Verdict.USE
    assert decide(both, "STATUS", own=False) is Verdict.OVERSEE
    assert decide(both, "MOVE", own=False) is Verdict.DENIED
    assert decide([], "PING", own=True) is Verdict.UNKNOWN
    assert decide(both, "SHUTDOWN", own=True) is Verdict.DENIED

"""Every error code gives an exception that has the code."""

import mesh_motion_client
import mesh_motion_client.errors
import pytest
from mesh_motion_protocol import errors
from mesh_motion_protocol.errors import ERROR_CODES, error_from
from mesh_motion_protocol.messages import ErrorReply


def reply(code, **details):
    return ErrorReply(code=code, message="m", hint="h", retryable=False, state="", details=details)


@pytest.mark.parametrize("code", ERROR_CODES)
def test_every_code_has_a_class(code):
    error = error_from(reply(code, a=1))
    assert (error.code, str(error), error.details) == (code, "m (h)", {"a": 1})
    assert isinstance(error, errors.ServerFault) == (code == "INTERNAL")


def test_an_unknown_detail_is_its_canonical_name():
    assert type(error_from(reply("INVALID_ARGUMENT.FROM_A_LATER_VERSION"))) is errors.InvalidInput
    assert type(error_from(reply("NEVER_SEEN"))) is errors.ServerFault


def test_the_public_names_are_sorted_and_exist():
    for module in (mesh_motion_client, mesh_motion_client.errors):
        assert sorted(module.__all__) == list(module.__all__)
        assert all(hasattr(module, name) for name in module.__all__)


def test_the_client_s_errors_are_those_of_the_server():
    for name in mesh_motion_client.errors.__all__:
        assert getattr(mesh_motion_client.errors, name) is getattr(errors, name) is getattr(mesh_motion_client, name)

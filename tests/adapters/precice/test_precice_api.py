"""The stub and the participant's calls agree with the published API; installed real bindings are compared too."""

import importlib.util
import inspect

import pytest
from mesh_motion_client import Unavailable
from mesh_motion_precice.api import Coupling, connect_precice
from precice_stub import Participant as Stub
from precice_stub import PreciceError
from published_precice import CONSTRUCTOR, SIGNATURES

INSTALLED = importlib.util.find_spec("precice") is not None


def public(kind):
    return {name: value for name, value in vars(kind).items() if callable(value) and not name.startswith("_")}


def parameters(function):
    listed = list(inspect.signature(function).parameters.values())[1:]
    return tuple(p.name if p.default is p.empty else f"{p.name}={p.default}" for p in listed)


@pytest.mark.parametrize("kind", [Stub, Coupling])
def test_methods_have_the_published_signatures(kind):
    methods = public(kind)
    assert len(methods) >= 13
    assert {name: parameters(method) for name, method in methods.items()} == {n: SIGNATURES[n] for n in methods}


def test_the_stub_has_everything_that_the_participant_uses():
    assert set(public(Coupling)) <= set(public(Stub))
    assert parameters(Stub.__init__) == CONSTRUCTOR


@pytest.mark.skipif(not INSTALLED, reason="preCICE 3 and its Python bindings are not installed")
def test_the_real_bindings_have_them_too():
    import precice  # noqa: PLC0415

    for name, expected in SIGNATURES.items():
        assert parameters(getattr(precice.Participant, name)) == expected, name


def test_bindings_that_are_missing_are_said_in_one_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "precice", None)
    with pytest.raises(Unavailable, match=r"cannot be imported.*pip install"):
        connect_precice("MeshMotion", "precice-config.xml")


def refused(stub, words, method, *arguments):
    with pytest.raises(PreciceError, match=words):
        getattr(stub, method)(*arguments)


def test_the_stub_refuses_what_precice_refuses(stub, square):
    precice = stub([2, 1], initial_data=True)
    ids = precice.set_mesh_vertices("Lower", square.points[:3])
    refused(precice, "Initial data", "initialize")
    assert precice.requires_initial_data()
    refused(precice, "before", "is_coupling_ongoing")
    refused(precice, "before", "read_data", "Lower", "Displacement", ids, 0.0)
    precice.initialize()
    refused(precice, "locked", "set_mesh_vertices", "Lower", square.points[:3])
    refused(precice, "outside", "read_data", "Lower", "Displacement", ids, 0.11)
    refused(precice, "Vertex ID", "read_data", "Lower", "Displacement", ids + 1, 0.1)
    refused(precice, "unknown", "read_data", "Lower", "Force", ids, 0.1)
    refused(precice, "write checkpoint", "advance", 0.1)
    assert precice.requires_writing_checkpoint()
    assert not precice.requires_writing_checkpoint()
    refused(precice, "exceeds", "advance", 0.2)
    precice.advance(0.1)
    refused(precice, "read checkpoint", "advance", 0.1)
    assert precice.requires_reading_checkpoint()
    assert not precice.is_time_window_complete()
    precice.advance(0.1)
    assert precice.is_time_window_complete()

"""The asynchronous client: the same results while the event loop runs, with several sessions at the same time."""

import asyncio
import inspect
import threading

import mesh_motion_client
import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Server, Session, SessionError, Unavailable, aio, connect

UP = np.array([[0.0, 0.25]] * 4)
#: By which the client's own modules work together; what ``inner`` shows; what the end of the server's context does.
OF_SESSION = {"join", "upload", "take", "take_again", "leave", "forget_correction", "description", "plot", "state_of"}
OF_SERVER = {"description", "close"}


@pytest.mark.parametrize(("of", "beyond"), [("Session", OF_SESSION), ("Server", OF_SERVER)])
def test_it_has_every_call_with_the_same_arguments(of, beyond):
    blocking, awaited = getattr(mesh_motion_client, of), getattr(aio, of)
    calls = {name for name, value in vars(blocking).items() if inspect.isfunction(value) and name[0] != "_"} - beyond
    assert {name for name in vars(awaited) if name[0] != "_"} == calls
    for name in calls:
        assert inspect.signature(getattr(awaited, name)) == inspect.signature(getattr(blocking, name))
    assert inspect.signature(aio.connect) == inspect.signature(connect)


def test_a_step_with_the_same_answers(server, mesh, session):
    async def run():
        async with aio.connect(server.endpoint) as remote, remote.open(mesh, {"support_radius": 1.0}) as own:
            assert repr(remote) == repr(remote.inner)
            assert own.inner.moving_nodes.tolist() == [0, 4, 8, 12]
            with pytest.raises(InvalidInput, match="did you mean 'left'"):
                await own.move({"lefd": UP})
            moved = await own.move({"left": UP})
            committed = await own.commit()
            return moved.displacement, committed.digest, await own.points()

    displacement, digest, points = asyncio.run(run())
    assert (displacement == session.move(UP).displacement).all()
    assert digest == session.commit().digest
    assert (points == session.points()).all()


def test_wrong_ways_to_use_it_are_named(server, mesh):
    async def run():
        with pytest.raises(InvalidInput, match=r"aio.connect\(…\) is a context, .* \(async with aio.connect"):
            await aio.connect(server.endpoint)
        async with aio.connect(server.endpoint) as remote:
            with pytest.raises(InvalidInput, match=r"server.open\(…\) is a context, .* \(async with server.open"):
                await remote.open(mesh)
            async with remote.open(mesh) as own:
                with pytest.raises(AttributeError, match=r"Session has no 'moving_nodes': read inner\.moving_nodes"):
                    _ = own.moving_nodes
                with pytest.raises(AttributeError, match=r"Session has no 'comit'$"):
                    await own.comit()
            with pytest.raises(SessionError, match="the session is closed"):
                await own.move({"left": UP})
        with pytest.raises(Unavailable, match="the connection to the server is closed"):
            await remote.sessions()
        with pytest.raises(Unavailable, match="the connection to the server is closed"):
            async with remote.open(mesh):
                pass

    asyncio.run(run())


def test_two_sessions_wait_at_the_same_time_and_the_loop_goes_on(server, mesh):
    async def run():
        async with aio.connect(server.endpoint) as remote, remote.open(mesh) as one, remote.open(mesh) as other:
            with server.hold():
                moves = [asyncio.ensure_future(each.move(UP)) for each in (one, other)]
                while server.moves() < 2:  # both are with the server, and neither is answered
                    await asyncio.sleep(0.01)
                assert not any(move.done() for move in moves)
            return [moved.iteration for moved in await asyncio.gather(*moves)]

    assert asyncio.run(run()) == [1, 1]


def test_a_cancelled_call_is_answered_when_it_is_repeated(server, mesh):
    async def run():
        async with aio.connect(server.endpoint) as remote, remote.open(mesh) as own:
            with server.hold(), pytest.raises(TimeoutError):
                await asyncio.wait_for(own.move(UP), 0.2)
            return (await own.move(UP)).displacement

    assert asyncio.run(run())[0].tolist() == [0.0, 0.25]


def test_a_session_that_comes_too_late_is_discarded(server, mesh, client, monkeypatch):
    gate, closed = threading.Event(), threading.Event()
    opened = Server.open
    monkeypatch.setattr(Session, "leave", lambda self, leave=Session.leave: (leave(self), closed.set()))
    slow = aio._opened(lambda self, *given: (gate.wait(20), opened(self, *given))[1], "discard")

    async def run():
        async with aio.connect(server.endpoint) as remote:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.1), slow(remote, mesh):
                    pass
            gate.set()
            await asyncio.to_thread(closed.wait, 20)

    before = len(client.sessions())
    asyncio.run(run())
    assert closed.is_set()
    assert len(client.sessions()) == before


def test_a_connection_without_a_waiter_is_closed(server, monkeypatch):
    gate, closed = threading.Event(), threading.Event()
    monkeypatch.setattr(Server, "close", lambda self, close=Server.close: (close(self), closed.set()))
    welcomed = Server.__init__
    monkeypatch.setattr(Server, "__init__", lambda self, *a, **k: (gate.wait(20), welcomed(self, *a, **k))[1])

    async def run():
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05), aio.connect(server.endpoint):
                pass

    asyncio.run(run())
    assert not closed.is_set()
    gate.set()
    assert closed.wait(20)

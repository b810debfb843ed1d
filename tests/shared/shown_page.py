"""A server with made-up sessions, and its page shown in a browser."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from chromium import Browser
from histories import write_history

from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import make_driver
from tests.faults.server_process import ServerProcess
from tests.faults.stand_in import grid_mesh


def stored(folder: Path, session: str, label: str, history: int, **options: Any) -> None:
    """Store a session with two committed steps, and a made-up history."""
    driver = make_driver(SessionStore(folder), [grid_mesh(9)], session=session, spec={"label": label})
    driver.open()
    driver.advance(1)
    driver.advance(2)
    driver.host.close()
    shutil.rmtree(folder / "sessions" / session / "history")
    write_history(folder / "sessions" / session, history, segments=2, **options)


@contextmanager
def serving(folder: Path) -> Iterator[ServerProcess]:
    """A server with a page that restarts at the same address; sessions may be stored from outside."""
    served = ServerProcess(folder, monitor="127.0.0.1:0")
    served.start()
    try:
        served.settings["monitor"] = served.announced["monitor"].removeprefix("tcp://")
        yield served
    finally:
        served.stop()


def show(tab: Browser, server: ServerProcess, session: str, *, mesh: bool = True, **window: Any) -> None:
    tab.show(f"http://{server.settings['monitor']}/#{session}", **window)
    await_session(tab, session, mesh=mesh)


def await_session(tab: Browser, session: str, *, mesh: bool = True) -> None:
    """Wait until the page shows a session's charts, and its mesh."""
    ready = (
        "const m = globalThis.monitor; return !!(m && m.key && m.key.startsWith(arguments[0]) "
        "&& (m.mesh.picture.naturalWidth && !m.mesh.picture.hidden || !arguments[1]) && m.history.columns.step.length)"
    )
    tab.wait(lambda: tab.run(ready, session, mesh), "the session is shown")

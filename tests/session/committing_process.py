"""Commits for ever, telling each acknowledged step; made to be killed. Arguments: state folder, first step."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from mesh_motion_server.session.store import SessionStore


def main(root: str, first: int) -> None:
    """Open or resume, then move and commit until killed."""
    spec = importlib.util.spec_from_file_location("kit", Path(__file__).with_name("conftest.py"))
    assert spec is not None
    assert spec.loader is not None
    kit = importlib.util.module_from_spec(spec)
    sys.modules["kit"] = kit
    spec.loader.exec_module(kit)
    store, mesh = SessionStore(root), kit.grid_mesh()
    if first == 0:
        driver = kit.make_driver(store, [mesh])
        driver.open()
    else:
        host = kit.SessionHost.resume(kit.SESSION, kit.TOKEN, store, build_model=kit.StandIn)
        driver = kit.Driver(host, [mesh])
        driver.sequences = [first * 1_000_000]
        driver.join()
    step = driver.host.step
    while True:
        step += 1
        (reply,) = driver.advance(step)
        sys.stdout.write(f"{reply.step} {reply.digest.hex()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))

"""What the session's tests share: a small mesh in one piece or several, and ranks that drive a session."""

from types import SimpleNamespace

import pytest
from mesh_motion_protocol.messages import Join

from mesh_motion_server.service.dispatch import Envelope
from proofs import model_files
from proofs.driver import SESSION, TOKEN, Driver, make_driver, make_spec, resume, resume_driver
from proofs.stand_in import StandIn, grid_mesh, split_mesh


@pytest.fixture
def kit() -> SimpleNamespace:
    """The builders of this module: test modules cannot import it."""
    return SimpleNamespace(
        StandIn=StandIn,
        grid_mesh=grid_mesh,
        split_mesh=split_mesh,
        make_spec=make_spec,
        TOKEN=TOKEN,
        SESSION=SESSION,
        files=model_files,
        make_driver=make_driver,
        resume=resume,
        resume_driver=resume_driver,
        Driver=Driver,
        Envelope=Envelope,
        Join=Join,
    )

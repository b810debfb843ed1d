"""A small driver for partitioned fluid-structure interaction: one fluid, one solid, and the mesh motion between them.

::

    errors        what can go wrong
    acceleration  Aitken's relaxation, the quasi-Newton method IQN-ILS
    mapping       displacements and loads between meshes that do not match
    fluid         OpenFOAM, which sends a request in every outer corrector
    coupling      windows, iterations, records of a run

For production use preCICE; this driver is for tests, teaching and single machines.
"""

from mesh_motion_fsi.acceleration import ACCELERATIONS, Acceleration, Aitken, ConstantRelaxation, QuasiNewton
from mesh_motion_fsi.coupling import Coupling, Fluid, Row, Settings, Solid, read_history
from mesh_motion_fsi.errors import FsiError, NotConvergedError, ParticipantError, RecordError, SetupError
from mesh_motion_fsi.fluid import OpenFoam, Request
from mesh_motion_fsi.mapping import Mapping

__all__ = [
    "ACCELERATIONS",
    "Acceleration",
    "Aitken",
    "ConstantRelaxation",
    "Coupling",
    "Fluid",
    "FsiError",
    "Mapping",
    "NotConvergedError",
    "OpenFoam",
    "ParticipantError",
    "QuasiNewton",
    "RecordError",
    "Request",
    "Row",
    "Settings",
    "SetupError",
    "Solid",
    "read_history",
]

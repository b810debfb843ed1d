"""A mesh solver of Kratos Multiphysics that uses the mesh-motion server.

::

    names               register(): "solver_type": "mesh_motion_kratos.remote_mesh_motion"
    remote_mesh_motion  the mesh solver on Kratos' MeshSolverBase
    fluid_wrapper       CoSimulation's fluid with that mesh solver
    mesh_wrapper        CoSimulation's participant that only moves a mesh
    participant         a session of a part: open or resume, move, commit
    part                a model part as arrays
    settings            the block "remote"
    session_file        the file by which a restarted run finds its session
    errors              the errors, each with a hint what to do
"""

from mesh_motion_kratos.errors import KratosAdapterError, MotionError, PartError, SettingsError
from mesh_motion_kratos.names import register

__all__ = ["KratosAdapterError", "MotionError", "PartError", "SettingsError", "register"]

"""The preCICE participant that moves a mesh: boundary displacements in, displacements of the mesh's nodes out.

::

    configuration   the participant's file: patches with the data they read, the data it writes, the method
    adapter_config  the same in JSON, by preCICE's guidelines for adapters
    api             the part of preCICE 3 that is used
    vertices        the preCICE meshes: wet surfaces that read, a volume that writes
    connectivity    their edges, triangles and tetrahedra
    run_length      how many windows a run has
    participant     the coupling loop: trial moves, checkpoints, committed windows
    command         mesh-motion-precice
"""

from mesh_motion_precice.configuration import Configuration, Surface, Volume, read_configuration
from mesh_motion_precice.participant import Participant, Window, resume_session
from mesh_motion_precice.vertices import nodes_at

__all__ = [
    "Configuration",
    "Participant",
    "Surface",
    "Volume",
    "Window",
    "nodes_at",
    "read_configuration",
    "resume_session",
]

"""Mesh motion as a component of OpenMDAO, named as MPhys names a mesh warper."""

from mesh_motion_openmdao.component import MeshMotion

__all__ = ["MeshMotion"]

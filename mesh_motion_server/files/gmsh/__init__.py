"""Gmsh: the mesh of a .msh file, and the numbers of its sections."""

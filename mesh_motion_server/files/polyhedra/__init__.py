"""Meshes given by their faces: the cells found again, and polyhedra divided into pieces."""

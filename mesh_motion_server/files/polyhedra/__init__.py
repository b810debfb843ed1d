"""Meshes given by their faces: identify the simple cells, and divide polyhedra into pieces."""

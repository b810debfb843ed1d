"""Figures of docs/explained.md: the steps from the given displacements to the displacements of all nodes."""

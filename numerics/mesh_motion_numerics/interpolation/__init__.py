"""Interpolation of boundary displacements by radial basis functions, and its values at many points."""

"""Interpolation in two scales, exact at every boundary node, with a cost linear in the nodes.

A *coarse* interpolation of a few hundred control points carries the motion far into the volume. It is evaluated only at
the points of nested grids (:mod:`.nested_grid`), with a cubic spline between these points. The error that remains at
the boundary nodes, from the coarse points and from the spline, is interpolated by *compact* functions a few boundary
spacings wide (:mod:`.compact_levels`). So the boundary stays exact for any number of coarse points and any grid.
"""

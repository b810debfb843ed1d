"""Interpolation in two scales, exact at every boundary node at a cost that grows with the nodes alone.

A *coarse* interpolation of a few hundred control points carries the motion far into the volume. It is evaluated on
nested grids only (:mod:`.nested_grid`), and between their points by a cubic spline. What that sum leaves at the
boundary nodes, the coarse points' own error and the spline's alike, is interpolated by *compact* functions a few
boundary spacings wide (:mod:`.compact_levels`), so that neither the number of coarse points nor the grid touches the
boundary's exactness.
"""

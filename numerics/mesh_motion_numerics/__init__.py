"""The method: arrays in, arrays out, without sessions, files or sockets.

:mod:`.motion.motion` is the way in, one motion from end to end; :mod:`.method` has its choices. A room imports only the
rooms above it::

    mesh            cells, facets, patches and roles, periodic pairs, sliding surfaces, layers on walls
    interpolation   basis functions, centres, factorizations, two scales; values at many points
    quality         metrics, summaries; whether a mesh is usable
    correction      freed nodes and enrichment: which motion raises the worst quality
    reduction       fewer control points, fewer places
    motion          the Move: interpolate, judge, correct, judge, accept or lead the mesh there in sub-steps

Loops over nodes, cells and control points are compiled (``kernels/`` of the checkout, ``mesh_motion_kernels`` here);
:mod:`.blas` keeps results of linear algebra the same for any number of threads, as those loops are.
"""

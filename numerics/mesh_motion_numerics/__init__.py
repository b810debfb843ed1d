"""The method: arrays in, arrays out, without sessions, files or sockets.

Start with :mod:`.motion.motion`, one motion from end to end; :mod:`.method` has its settings. A subpackage imports only
the subpackages above it::

    mesh            cells, facets, patches and roles, periodic pairs, sliding surfaces, layers on walls
    interpolation   basis functions, centres, factorizations, two scales; values at many points
    quality         metrics, summaries; whether a mesh is usable
    correction      freed nodes and enrichment: a motion with a better worst quality
    reduction       fewer control points, fewer places
    motion          the Move: interpolate, judge, correct, judge, accept or lead the mesh there in sub-steps
    distributed     many processes: the work of a rank, and the sums that the server makes of it

Loops over nodes, cells and control points are compiled (``kernels/`` of the checkout, ``mesh_motion_kernels`` here);
:mod:`.blas` keeps results of linear algebra the same for any number of threads, like the results of those loops.
"""

__version__ = "0.1.0"

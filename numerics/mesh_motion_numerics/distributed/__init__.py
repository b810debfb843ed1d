"""One mesh on many processes: the ranks of a client have nodes and cells, the server has the boundary.

A value of an interpolant depends on the interpolant and the point alone, and the quality of a cell on its own nodes. So
a rank works without the other ranks: it receives the field, moves its nodes and judges its cells (section 23 of the
protocol). The results are bit for bit those of one process, except for means, whose sums have another order.

::

    field.py             the displacement as arrays, from which a rank evaluates it
    rank.py              a rank: moves its nodes, judges its cells, reports the bad ones
    counted_cells.py     its cells, judged in one pass
    order_statistics.py  exact percentiles of values on many machines
    summaries.py         the quality of a mesh from that of its partitions
    judging.py, region.py  what JUDGE and CORRECT contain

The client imports this package in :mod:`mesh_motion_client.volume`.
"""

"""Beyond one machine: the mesh lies in partitions on workers of a Dask cluster, or with the ranks of a client, and per
step only the data that the boundary determines are sent to them.

A value of an interpolant depends on the interpolant and the point alone, and the quality of a cell on its own nodes. So
a worker that holds the nodes of its cells (some of them as a *halo* that another worker has too) needs no neighbour: it
receives the coefficients, moves its nodes, judges its cells, and keeps both. The result is that of one machine bit for
bit, except for the means, which are sums in another order.

::

    split.py             the mesh in partitions: nodes along the Morton curve, cells with the halo that they need
    packing.py           an interpolant on the wire: the part of it that reaches a partition
    held.py              what runs on a worker: positions by version, displacements, qualities
    order_statistics.py  exact percentiles of values that lie on many machines
    summaries.py         the quality of a mesh from that of its partitions
    connection.py        the way to the scheduler
    crew.py              asks all partitions something; rebuilds those of a lost worker
    versions.py          positions that both sides know, and the rows in which others differ from them
    evaluator.py         the evaluator and judge of a session: displacements come back
    fallback.py          computes on this machine while no worker answers, where the operator said so
    model.py             a session's model whose evaluator and judge lie on workers
    traffic.py           bytes on the wire by kind

Where the client's ranks have the mesh (section 23 of the protocol)::

    field.py             the displacement as arrays, from which a rank evaluates it
    rank.py              a rank: moves its nodes, judges its cells, tells of the bad ones
    counted_cells.py     its cells, judged in one pass
    judging.py, region.py  what JUDGE and CORRECT contain

Nothing else in the server imports ``dask`` or ``distributed``, and here only :func:`.connection.require_dask` does,
when it is needed: ``pip install 'mesh-motion-server[dask]'``.
"""

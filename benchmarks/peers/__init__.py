"""Mesh-motion systems side by side: the same meshes, the same motions, one judge, one machine, one run.

``python -m benchmarks.peers --out out/peers`` builds the meshes (:mod:`.meshes`) and the motions (:mod:`.motions`),
runs every system of :mod:`.systems` in a process of its own, judges the positions with the server's own metric
(:mod:`.judge`) and writes a table, a JSON file and a plot (:mod:`.report`).

A system is a *mover*: built from a :class:`~.task.Task` (set-up), then asked for the positions after each step. Movers
written in Python live in :mod:`.movers` and run in :mod:`.worker`; OpenFOAM is driven through files
(:mod:`.openfoam`).
"""

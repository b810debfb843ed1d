"""Comparison of mesh-motion systems: the same meshes and motions, one quality metric, one machine, one run.

``python -m benchmarks.peers --out out/peers`` builds the meshes (:mod:`.meshes`) and the motions (:mod:`.motions`),
runs every system of :mod:`.systems` in a separate process, computes the quality of the positions with the server's own
metric (:mod:`.judge`) and writes a table, a JSON file and a plot (:mod:`.report`).

A system is a *mover*: it is built from a :class:`~.task.Task` (set-up), then computes the positions after each step.
Movers written in Python are in :mod:`.movers` and run in :mod:`.worker`; OpenFOAM is controlled through files
(:mod:`.openfoam`).
"""

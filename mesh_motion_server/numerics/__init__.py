"""The method: arrays in, arrays out, without sessions, files or sockets.

:mod:`.motion` is the way in, one motion from end to end; :mod:`.method` has its choices. What it goes through::

    the mesh            cells.py, orientation.py, roles.py, mesh_check.py, patch_check.py, periodic_*.py, sliding.py,
                        boundary_layer*.py
    interpolation       standard_motion.py: interpolant.py with kernels.py, polynomial.py, factorizations/, reduction/,
                        two_scale/; many points at once in evaluation.py, far_field/, volume_reduction/
    prediction          prediction.py, many_steps.py, sampling/
    correction          correction.py: enrichment/, trial_nodes.py with newton.py and distortion.py
    large motions       sub_steps.py, led_motion.py, paths.py, body_paths.py
    quality             metrics.py, quality_summary.py, lowest_quality.py; in a solver's words finite_volume.py
    what is accepted    acceptance.py, boundary_crossing.py, boundary_orientation.py

Modules named ``*_kernels.py``, ``*_maps.py`` and the loops of :mod:`.summation` are compiled by numba; :mod:`.blas` and
:mod:`.threads` keep results the same for any number of threads.
"""

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

Loops over nodes, cells and control points are compiled (``kernels/`` of the checkout, ``mesh_motion_kernels`` here);
:mod:`.blas` keeps results of linear algebra the same for any number of threads, as those loops are.
"""

"""The Mok benchmark in Kratos, with Kratos' mesh solver and with the server: ``python -m mok_benchmark``, ``make mok``.

::

    benchmark   the published data
    meshes      the meshes, as Kratos' mdpa files
    parameters  Kratos' project parameters; the mesh solver is all that differs
    kratos_run  one run, in Kratos' Python
    execution   a run from outside: its folder, its processes, its progress
    verdict     the two histories compared, the quality of the meshes
    picture     the histories drawn
"""

"""The Mok benchmark in Kratos, with Kratos' mesh solver and with the server: ``python -m mok_benchmark``, ``make mok``.

The same modules run Turek and Hron's flag (``examples/turek_hron_fsi/kratos.py``).

::

    benchmark   the published data
    meshes      the meshes, as Kratos' mdpa files
    parameters  a case as Kratos' project parameters; the mesh solver is all that differs
    kratos_run  one run, in Kratos' Python
    execution   a run from outside: its folder, its processes, its progress
    verdict     the two histories compared, the quality of the meshes
    picture     the histories drawn
"""

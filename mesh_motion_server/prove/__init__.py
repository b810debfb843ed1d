"""What shows that the server keeps its promises: ``mesh-motion prove``.

:mod:`~mesh_motion_server.prove.check` says what a check is, :mod:`~mesh_motion_server.prove.table` lists them all,
:mod:`~mesh_motion_server.prove.runner` runs them. Each check has a module of its own; the tests call the same code with
small counts, and seed bugs that it must find. It stands apart from the server: nothing else imports it.
"""

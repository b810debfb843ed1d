"""Rights of users: roles and their rights (:mod:`.authorisation`), and the roles of each key (:mod:`.allow_list`).

This package has only values and one file; the sockets are in :mod:`mesh_motion_server.transport`.
"""

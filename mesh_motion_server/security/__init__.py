"""Who may do what: roles and their rights (:mod:`.authorisation`), and who has which role (:mod:`.allow_list`).

Values and one file; the sockets that ask are in :mod:`mesh_motion_server.transport`.
"""

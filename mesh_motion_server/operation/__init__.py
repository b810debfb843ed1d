"""Operating a running server: counts, readiness, free disk and memory, the service manager.

Values and functions without sockets, except the one datagram of :mod:`.service_manager`; :mod:`..transport.watch` and
:mod:`..transport.monitor` show them.
"""

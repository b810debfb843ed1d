"""Requests and replies: a message in, the messages that are due out, without a socket.

:mod:`.dispatch` is the way in. Each request type has a module with its name (:mod:`.join`, :mod:`.upload`,
:mod:`.build`, :mod:`.move`, :mod:`.commit`, :mod:`.rollback`, :mod:`.fetch`, :mod:`.status`, :mod:`.close`), in one of
the two shapes of :mod:`.commands`. :mod:`.execution` executes each once, :mod:`.gathering` waits until all partitions
have asked, :mod:`.holders` knows who may. :mod:`.reports` and :mod:`.failures` say what has become of it, and
:mod:`.counting` counts it.
"""

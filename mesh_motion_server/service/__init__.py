"""Requests and replies: turns a message into its reply messages, without a socket.

:mod:`.dispatch` is the entry point. Each request type has a module with its name (:mod:`.join`, :mod:`.upload`,
:mod:`.build`, :mod:`.move`, :mod:`.judge`, :mod:`.correct`, :mod:`.commit`, :mod:`.rollback`, :mod:`.fetch`,
:mod:`.status`, :mod:`.close`; TANGENT and COTANGENT share :mod:`.differentiate`), in one of the two shapes of
:mod:`.commands`. :mod:`.execution` executes each request once, :mod:`.gathering` waits until all partitions have sent
their requests, :mod:`.holders` checks the sender's right. :mod:`.reports` and :mod:`.failures` describe the result, and
:mod:`.recorder` records and counts it.
"""

"""The wire contract of the mesh-motion server, without sockets: messages, codec, error codes, golden vectors.

``SPEC.md`` in the repository's ``protocol/`` folder is authoritative; this package implements it for both ends.
It needs numpy and msgpack and nothing else.
"""

PROTOCOL_VERSION = (1, 0)

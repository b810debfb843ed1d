"""The wire contract of the mesh-motion server, without sockets: messages, codec, error codes, golden vectors.

``SPEC.md`` in the repository's ``protocol/`` folder is authoritative; this package implements it for both ends.
It needs numpy and msgpack and nothing else.

Modules, from the declarations to the frames: :mod:`.messages` says what exists (with :mod:`.control_messages`,
:mod:`.data_messages`, :mod:`.field_types`, :mod:`.declarations`), :mod:`.schema` reads that into tables, :mod:`.header`
packs frame 0, :mod:`.arrays` the frames after it, :mod:`.codec` puts both together. :mod:`.limits`, :mod:`.errors` and
:mod:`.digests` are the rest that both ends must agree on.
"""

PROTOCOL_VERSION = (1, 0)
#: Version of this distribution and of the server, which are released together.
__version__ = "0.1.0"

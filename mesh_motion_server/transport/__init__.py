"""Sockets and processes: the only part of the server with zmq.

::

    serve ─── supervisor (no sockets)           sessions, workers, RESUME, drain
                 ├── gateway                    the control endpoint: headers only, forwards what it does not answer
                 ├── monitor                    metrics and probes over HTTP, if configured
                 ├── template                   everything imported; workers are forked from it
                 ├── worker  session A          a data endpoint each, its own memory limit
                 └── worker  session B

The supervisor talks to its children over socket pairs (:mod:`.channel`). A native crash, an exhausted memory or an
endless multipart message hurts one session; a gateway that fails is started again on the same endpoint. Children end
with the supervisor. :mod:`.serve` is the entry point.
"""

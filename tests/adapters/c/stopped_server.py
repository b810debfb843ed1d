"""A server that falls silent after JOINED: ``python stopped_server.py`` prints its endpoint."""

import os
import signal
import sys
import time

from mesh_motion_conformance.client.scripted_server import ScriptedServer

if __name__ == "__main__":
    server = ScriptedServer([], {})
    sys.stdout.write(f"{server.endpoint}\n")
    sys.stdout.flush()
    while not any(seen.message.kind == "JOIN" for seen in server.seen):
        time.sleep(0.001)
    time.sleep(0.05)  # the reply is on its way; the points are more than the buffers of a connection hold
    os.kill(os.getpid(), signal.SIGSTOP)
    time.sleep(60)

"""Runs a server with the fake service: ``python run_server.py SETTINGS_JSON READY_FILE [WORD…]``.

Words: insecure, no-numerics; stopped-at-once: SIGTERM comes as soon as the server has reported that it is ready.
"""

import os
import signal
import sys
from pathlib import Path

from fake_service import SessionStore

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import serve as serving
from mesh_motion_server.transport import supervisor
from mesh_motion_server.transport.serve import serve


def announce_and_stop(*given):
    announce(*given)
    os.kill(os.getpid(), signal.SIGTERM)


announce = serving._announce
if "stopped-at-once" in sys.argv:
    serving._announce = announce_and_stop

if __name__ == "__main__":
    settings = ServerSettings.model_validate_json(sys.argv[1])
    supervisor.SessionStore = SessionStore
    template = "no_numerics" if "no-numerics" in sys.argv else "fake_service"
    sys.exit(
        serve(settings, ready_file=Path(sys.argv[2]), insecure="insecure" in sys.argv, template=template, level="debug")
    )

"""Runs a server with the plain model: ``python run_server.py SETTINGS_JSON READY_FILE``."""

import sys
from pathlib import Path

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.serve import serve

if __name__ == "__main__":
    settings = ServerSettings.model_validate_json(sys.argv[1])
    sys.exit(serve(settings, ready_file=Path(sys.argv[2]), template="plain_service"))

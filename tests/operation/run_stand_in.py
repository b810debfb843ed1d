"""Serves with the stand-in for the numerics: ``python run_stand_in.py SETTINGS_JSON READY_FILE LEVEL``."""

import sys
from pathlib import Path

from mesh_motion_server.prove.stand_in_server import SERVICE
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.hosting import Hosting
from mesh_motion_server.transport.serve import serve

if __name__ == "__main__":
    settings, ready_file, level = sys.argv[1:]
    hosting = Hosting(SERVICE, SERVICE, SERVICE)
    sys.exit(
        serve(ServerSettings.model_validate_json(settings), ready_file=Path(ready_file), hosting=hosting, level=level)
    )

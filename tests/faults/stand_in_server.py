"""A whole server whose workers compute with the stand-in: quick to start, kill and ask.

``python -m tests.faults.stand_in_server SETTINGS_JSON READY_FILE LEVEL`` runs it; :class:`StandInServer` starts that
and knows its processes. Everything except the numerics is that of ``mesh-motion serve``.
"""

import json
import sys
from pathlib import Path

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.serve import serve
from tests.faults.server_process import ServerProcess

#: Module that the template runs: its workers have the host and the store of this module.
_SERVICE = "tests.faults.stand_in_service"


class StandInServer(ServerProcess):
    """See :class:`.server_process.ServerProcess`."""

    def command(self, ready: Path) -> list[str]:
        """See :class:`.server_process.ServerProcess`."""
        return ["-m", __name__, json.dumps(self.settings), str(ready), self.level]


def main(settings: str, ready: str, level: str) -> int:
    return serve(ServerSettings.model_validate_json(settings), ready_file=Path(ready), level=level, template=_SERVICE)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

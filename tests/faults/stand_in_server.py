"""A whole server whose workers compute with the stand-in: quick to start, kill and ask.

``python -m tests.faults.stand_in_server SETTINGS_JSON READY_FILE SERVICE LEVEL`` runs it;
:class:`StandInServer` starts that and knows its processes. Everything but the numerics is what ``mesh-motion serve``
runs.
"""

import json
import sys
from pathlib import Path
from typing import Any

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.serve import serve
from tests.faults.server_process import ServerProcess

#: Module that the template runs: its workers have the host and the store of this module.
SERVICE = "tests.faults.stand_in_service"


class StandInServer(ServerProcess):
    """See :class:`.server_process.ServerProcess`.

    ``service``: module that workers load; ``options``: as for every server process.
    """

    def __init__(self, folder: Path, *, service: str = SERVICE, **options: Any) -> None:
        super().__init__(folder, **options)
        self._service = service

    def command(self, ready: Path) -> list[str]:
        """See :class:`.server_process.ServerProcess`."""
        return ["-m", __name__, json.dumps(self.settings), str(ready), self._service, self.level]


def main(settings: str, ready_file: str, service: str, level: str) -> int:
    """Serve."""
    return serve(
        ServerSettings.model_validate_json(settings), ready_file=Path(ready_file), level=level, template=service
    )


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

"""What transport needs of the layers below it: a host for one session, and the store of all sessions.

Both are given by module name, so that the supervisor imports no numerics and a test may use its own host, which has the
methods of :class:`mesh_motion_server.service.dispatch.SessionHost`.
"""

import importlib
from dataclasses import dataclass
from typing import Any

__all__ = ["Hosting"]


@dataclass(frozen=True)
class Hosting:
    """The modules that provide ``SessionHost`` and ``SessionStore``, and modules that a worker imports in advance."""

    host: str = "mesh_motion_server.service.dispatch"
    store: str = "mesh_motion_server.session.store"
    numerics: str = "mesh_motion_numerics.motion.motion"

    def load_host(self) -> Any:
        """Return the class ``SessionHost``, with everything imported that its first request needs."""
        importlib.import_module(self.numerics)
        return importlib.import_module(self.host).SessionHost

    def load_store(self) -> Any:
        """Return the class ``SessionStore``."""
        return importlib.import_module(self.store).SessionStore

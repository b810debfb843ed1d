"""The connection to a Dask scheduler, opened at its first use.

Whoever can reach a scheduler or a worker can run code there. So the address comes from the operator of the server
alone, never from a client's message, and the connection must be protected (``tls://`` with certificates, or a private
network).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mesh_motion_server.errors import InvalidInput, ResourceError

__all__ = ["Connection", "no_workers", "require_dask"]


def require_dask() -> Any:
    """Return the package ``distributed``.

    Raises
    ------
    InvalidInput
        If it is not installed.
    """
    try:
        # an extra, and half a second to import
        import distributed  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput(
            "partitions on Dask workers need the package distributed, which is not installed",
            code="UNIMPLEMENTED",
            hint="pip install 'mesh-motion-server[dask]'",
        ) from error
    return distributed


@dataclass(eq=False)
class Connection:
    """The address of a scheduler, with time limit and certificates.

    Attributes
    ----------
    address : str
        ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    patience : float
        Seconds to wait without any worker, or without the scheduler.
    tls_ca_file, tls_certificate, tls_key : Path or None
        For ``tls://``: trusted certificates and this server's own. Without them Dask's own configuration is used.
    """

    address: str
    patience: float = 30.0
    tls_ca_file: Path | None = None
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    _client: Any = field(default=None, repr=False)

    def client(self) -> Any:
        """Return the connected ``distributed.Client``; a new one if the last was closed.

        Raises
        ------
        ResourceError
            UNAVAILABLE if the scheduler does not answer in time.
        """
        if self._client is not None and self._client.status in ("running", "connecting"):
            return self._client
        distributed = require_dask()
        try:
            self._client = distributed.Client(
                self.address,
                timeout=self.patience,
                security=self._security(distributed),
                direct_to_workers=True,
                set_as_default=False,
                name="mesh-motion",
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise ResourceError(
                f"the Dask scheduler at {self.address} does not answer: {error}",
                code="UNAVAILABLE",
                hint="start it (dask scheduler), or serve without --distributed",
            ) from error
        return self._client

    def workers(self) -> list[str]:
        """Return the sorted addresses of the scheduler's workers; none if it does not answer."""
        client = self.client()
        try:
            return sorted(client.sync(client.scheduler.ncores, callback_timeout=self.patience))
        except (OSError, TimeoutError):
            return []

    def wait_for_workers(self) -> list[str]:
        """Return :meth:`workers` when there is at least one.

        Raises
        ------
        ResourceError
            UNAVAILABLE if there is none in time.
        """
        begin = time.monotonic()
        while not (found := self.workers()):
            if time.monotonic() - begin > self.patience:
                raise no_workers(self.address, self.patience)
            time.sleep(min(0.5, self.patience / 10.0))
        return found

    def close(self) -> None:
        """Disconnect; the scheduler frees the data of this connection. Idempotent."""
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _security(self, distributed: Any) -> Any:
        if self.tls_ca_file is None:
            return None
        files = {
            "tls_ca_file": self.tls_ca_file,
            "tls_client_cert": self.tls_certificate,
            "tls_client_key": self.tls_key,
        }
        given = {name: str(file) for name, file in files.items() if file is not None}
        return distributed.Security(require_encryption=True, **given)


def no_workers(address: str, seconds: float) -> ResourceError:
    """Return the error for a cluster without workers."""
    return ResourceError(
        f"no Dask worker has answered at {address} for {seconds:.0f} s",
        code="UNAVAILABLE",
        hint=f"start workers (dask worker {address}) and send the request again, or serve without --distributed",
    )

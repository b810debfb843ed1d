"""Asks a server's pages for Prometheus and probes."""

import urllib.error
import urllib.request

from tests.faults.waiting import wait_until


def address_of(server):
    return server.announced["metrics"].replace("tcp://", "http://")


def get(server, page, method="GET"):
    """Return status and text; repeated if a busy machine does not answer within the page's five seconds."""
    request = urllib.request.Request(address_of(server) + page, method=method)

    def answer():
        try:
            with urllib.request.urlopen(request, timeout=60) as reply:
                return reply.status, reply.read().decode()
        except urllib.error.HTTPError as refusal:
            with refusal:
                return refusal.code, refusal.read().decode()
        except OSError:
            return None

    return wait_until(answer, f"{page} is answered")

"""Error codes and exit statuses, from the tables that the program uses."""

from __future__ import annotations

import re

from mesh_motion_protocol.errors import ERROR_CODES, error_from
from mesh_motion_protocol.message import ErrorReply

from docs.site.reference.tables import code, table
from mesh_motion_server.commands import outcome

__all__ = ["error_codes", "exit_statuses"]


def error_codes() -> str:
    """Each code: its meaning, the remedy, whether the same request may succeed later, and Python's exception."""
    rows = []
    for error in ERROR_CODES.values():
        reply = ErrorReply(
            code=error.code, message="", hint="", retryable=error.retryable, state=error.state, details={}
        )
        raised = type(error_from(reply))
        again = "yes" if error.retryable else "no"
        rows.append((code(error.code), error.meaning, error.hint, again, error.state, code(raised.__name__)))
    return table(("code", "means", "way out", "may be repeated", "session", "Python"), rows)


def exit_statuses() -> str:
    """The statuses of the command line, from its own description."""
    found = re.findall(r"^(\d+) +(\S.*)$", outcome.__doc__ or "", re.MULTILINE)
    return table(("status", "means"), [(status, text.strip()) for status, text in found])

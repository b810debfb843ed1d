"""Requirements for every reply, and the two possible answers: the reply of the table, or an ERROR with its code."""

from __future__ import annotations

from typing import Any

from mesh_motion_conformance.case import Unmet, require
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Message, check_reply

__all__ = ["answered", "check_identity", "refused"]


def check_identity(reply: Message, client: bytes, sequence: int) -> None:
    """A reply has the request id of its request (section 4) and the fields of its message (section 12)."""
    if (reply.client, reply.sequence) != (client, sequence):
        raise Unmet(f"the request id of the request, {client[:4].hex()}…, {sequence}", show(reply))
    check_reply(reply)


def answered(reply: Message, kind: str, **fields: Any) -> Message:
    """Check that the reply is of the given kind and has these values in its fields, and return it."""
    require(reply.kind == kind and _has(reply.fields, fields), f"{kind}{_with(fields)}", show(reply))
    return reply


def refused(reply: Message, *codes: str, state: str | None = None, **details: Any) -> Message:
    """Check that the reply is an ERROR with one of the codes (a canonical name includes its details), and return it.

    Parameters
    ----------
    state : str, optional
        The required ``state``: the session's state afterwards.
    details
        Values that its ``details`` must have.
    """
    wanted = " or ".join(codes)
    require(reply.kind == "ERROR", f"ERROR {wanted}", show(reply))
    code = reply.fields["code"]
    require(code in codes or code.partition(".")[0] in codes, f"ERROR {wanted}", show(reply))
    check_error(reply)
    require(state is None or reply.fields["state"] == state, f"state {state!r} in the ERROR", show(reply))
    require(_has(reply.fields["details"], details), f"an ERROR whose details name it{_with(details)}", show(reply))
    return reply


def _has(found: dict[str, Any], wanted: dict[str, Any]) -> bool:
    return {name: found.get(name) for name in wanted} == wanted


def _with(wanted: dict[str, Any]) -> str:
    return "".join(f", {name} {value!r}" for name, value in wanted.items())


def check_error(reply: Message) -> None:
    """Section 17: a known canonical name, ``retryable`` as the table says, a message and a hint, a state."""
    fields, errors = reply.fields, tables().errors
    code = fields["code"]
    require(code.partition(".")[0] in errors, "a code that begins with a canonical name of section 17", show(reply))
    if code in errors and fields["retryable"] != errors[code]["retryable"]:
        raise Unmet(f"retryable {errors[code]['retryable']} with {code}", show(reply))
    require(fields["message"] and fields["hint"], "an ERROR with a message and a hint", show(reply))
    require(fields["state"] in ("", *tables().states), "a state of section 8 in the ERROR", show(reply))

"""Requests as their senders know them, the replies that are due to them, and the comparison with those that came."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ERROR_CODES
from numpy.typing import NDArray

from tests.faults.check import require
from tests.faults.in_process_parts import Replies

Codes = tuple[str, ...]
#: Fields that may differ when a request is repeated (section 10).
_NO_CONTENT = ("client", "sequence", "epoch")


@dataclass(frozen=True, eq=False)
class Asked:
    """A request with all that its sender knows.

    ``user``, ``peer``: its key and its connection; ``wrong``: codes of which one is expected because of the content, in
    any state; ``far``: a MOVE that no valid mesh can follow.
    """

    kind: str
    user: str
    peer: bytes
    message: Any
    wrong: Codes = ()
    far: bool = False

    @property
    def content(self) -> Any:
        """Parts that a repeated reply must have in common."""
        values = {
            name: value for name, value in vars(self.message).items() if name not in ("client", "sequence", "epoch")
        }
        rows = [value.tobytes() if isinstance(value, np.ndarray) else value for value in values.values()]
        return self.kind, rows


@dataclass
class Answer:
    """An expected reply: its type, for an error the allowed codes, and fields; ``effect`` is called with the reply."""

    to: Asked
    type: str
    codes: Codes = ()
    fields: dict[str, Any] = field(default_factory=dict)
    same: Any = None
    effect: Callable[[Any], None] = lambda _: None

    @property
    def is_harmless(self) -> bool:
        """Whether it is a refusal that must change nothing; failing disks and defects may freeze the session."""
        return self.type == "ERROR" and not {"INTERNAL", "RESOURCE_EXHAUSTED.DISK"} & set(self.codes)


@dataclass(frozen=True)
class Share:
    """The data of a partition: global ids (n,), local indices of its moving nodes, coordinates (n, d), number of
    uploads.
    """

    ids: NDArray[np.int64]
    moving: NDArray[np.int64]
    points: NDArray[np.float64]
    parts: int


def compare_all(answers: Sequence[Answer], replies: Replies) -> None:
    """Match replies to their expected receivers, in any order."""
    got = {(peer, m.client, m.sequence): m for peer, m in ((peer, decode(frames)) for peer, frames in replies)}
    due = {(a.to.peer, a.to.message.client, a.to.message.sequence): a for a in answers}
    require(len(got) == len(replies), "a request has two replies")
    came = [f"{m.type} {getattr(m, 'code', '')}" for m in got.values()]
    require(got.keys() == due.keys(), f"due are {[(a.type, a.codes) for a in answers]}, came {came}")
    for key, answer in due.items():
        compare(answer, got[key])


def compare(answer: Answer, reply: Any) -> None:
    """Compare type, code, whether a retry can succeed, and all fields that the model knows."""
    kind = answer.to.kind
    if reply.type == "ERROR":
        good = any(reply.code == code or reply.code.startswith(code + ".") for code in answer.codes)
        due = f"{answer.type} {' or '.join(answer.codes)}"
        require(good, f"{kind} was refused by {reply.code} ({reply.message}), due was {due}")
        require(reply.retryable == ERROR_CODES[reply.code].retryable, f"{reply.code} says retryable {reply.retryable}")
    else:
        require(reply.type == answer.type, f"{kind} was answered {reply.type}, due was {answer.type} {answer.codes}")
    for name, value in answer.fields.items() if reply.type == answer.type else ():
        same = np.array_equal(getattr(reply, name), value)
        require(same, f"{name} of the {reply.type} to {kind} is {getattr(reply, name)!r}, not {value!r}")
    if answer.same is not None:
        again = [list(map(bytes, encode(m))) for m in (answer.same, reply)]
        require(again[0] == again[1], f"a repeated {kind} has another {reply.type}")
    answer.effect(reply)

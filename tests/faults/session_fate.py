"""What becomes of a modelled session when its lease, its process or its server ends, and how RESUME finds it."""

from dataclasses import replace
from functools import partial
from typing import Any

from tests.faults.check import require
from tests.faults.expected import Answer, Asked
from tests.faults.session_model import SessionModel
from tests.faults.session_table import DISK, OTHERS


class MortalSession(SessionModel):
    """A session whose process may end."""

    # --- what happens to it ------------------------------------------------------------------------------------------

    def lease_ends(self) -> list[Answer]:
        """No client was connected for too long."""
        self.admits("LEASE_END")
        self.unreported = False
        self.all_is_durable()
        if self.state in ("READY", "TRIAL"):
            self.lose_trial("SUSPENDED")
        abandoned = self.abandon("ABORTED")
        if self.state in ("NEW", "OPENING"):
            self.end(discard=True)
        return abandoned

    def time_out(self) -> list[Answer]:
        """Those who wait for partitions have waited long enough."""
        return self.abandon("DEADLINE_EXCEEDED")

    def ends(self) -> None:
        """The server stops: the worker closes its journal; no waiting client gets an answer."""
        self.all_is_durable()
        self.end(discard=False)

    def crashes(self, worker: str) -> None:
        """The process is gone; PROBE will say this of it."""
        self.state, self.worker, self.unreported = "", worker, False
        self.joined, self.waiting = {}, {}
        self.forget()
        self.trial, self.iteration = [], 0

    # --- RESUME and PROBE --------------------------------------------------------------------------------------------

    def gate_control(self, asked: Asked) -> Answer | None:
        """Who asks, with which token, of a session that is there."""
        may, code = OTHERS.get(asked.user, (asked.kind, ""))
        if asked.kind not in may.split():
            return self.refuse(asked, code, state="")
        if self.gone or (asked.user == "owner" and asked.message.token != self.token):
            return self.refuse(asked, "NOT_FOUND", state="")
        return None

    def resume(self, asked: Asked, fault: str = "") -> Answer:
        """Of a worker that lives, or from the journal."""
        if self.worker == "alive" and self.admits("RESUME"):
            if not (fault and self.built):
                state = self.state if not self.built else "READY"
                return Answer(asked, "RESUMED", fields={"epoch": self.epoch + 1}, effect=partial(self._resumed, state))
            self.lose_trial("FROZEN")
        if self.worker == "alive":
            self.crashes("dead")
        if self.may_be_found == [None]:
            self.worker = "none"
            return self.refuse(asked, "NOT_FOUND", state="")
        perhaps = ("NOT_FOUND",) if None in self.may_be_found else ()
        if fault:
            return Answer(asked, "ERROR", (DISK, *perhaps), {"state": ""}, effect=self._found)
        return Answer(asked, "RESUMED", perhaps, effect=self._found)

    def _resumed(self, state: str, reply: Any) -> None:
        """By the worker that lives."""
        require((reply.state, reply.step) == (state, self.step), f"RESUMED says {reply.state} at step {reply.step}")
        self.epoch, self.joined, self.waiting, self.discarded = reply.epoch, {}, {}, False
        self.all_is_durable()
        if self.built:
            self.lose_trial("READY")
            self.lost = "surely" if self.lost == "surely" else "perhaps"

    def _found(self, reply: Any) -> None:
        """From the journal, or not at all."""
        if reply.type == "ERROR":
            self.may_be_found, self.worker = [None] if reply.code == "NOT_FOUND" else self.may_be_found, "none"
            return
        require(reply.epoch > self.epoch, f"epoch {reply.epoch} after {self.epoch}")
        found = [snapshot for snapshot in self.may_be_found if snapshot and snapshot.step == reply.step]
        require(found, f"RESUMED says step {reply.step}, {self.step} was committed")
        snapshot = found[0]
        require(snapshot is not None and reply.state == "READY", f"RESUMED says {reply.state}")
        self.state, self.worker, self.epoch, self.joined = "READY", "alive", reply.epoch, {}
        self.discarded, self.reopened = False, True
        self._adopt(snapshot)

    def _adopt(self, snapshot: Any) -> None:
        """It was this one that was durable; if a COMMIT made it, that COMMIT was executed."""
        self.durable_step = snapshot.step
        for book in self.books.values():
            book.forget_steps_after(snapshot.step)
        self.step, self.committed, self.may_be_found = (
            snapshot.step,
            snapshot.committed,
            [replace(snapshot, commits=())],
        )
        about = {"step": snapshot.step, "durable_step": snapshot.step, "digest": snapshot.digest}
        if snapshot.commits:
            self.lost = "perhaps"
        for asked in snapshot.commits:
            self.executed(asked, "COMMITTED", **about)

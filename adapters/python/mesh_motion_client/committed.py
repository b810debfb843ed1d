"""The reply to a Commit, as users of the client get it."""

from __future__ import annotations

from dataclasses import dataclass

from mesh_motion_protocol import messages

from mesh_motion_client.display import Described
from mesh_motion_client.quality import QualitySummary

__all__ = ["Committed"]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Committed(Described, messages.Committed):
    """A committed step; its fields are those of the message.

    Attributes
    ----------
    step : int
    durable_step : int
        No crash and no power loss takes the session back to an earlier step.
    digest : bytes
        Digest of the committed state.
    quality : QualitySummary
        Quality of the committed mesh.
    """

    quality: QualitySummary  # type: ignore[assignment]  # what the message's dict holds

    def description(self) -> list[str]:
        """The step, how far the session is durable, and the worst quality."""
        durable = "durable" if self.durable_step == self.step else f"durable up to step {self.durable_step}"
        least, inverted = self.quality["metric"]["min"], self.quality["inverted"]
        return [f"Committed: step {self.step}, {durable}", f"quality: minimum {least:.3f}, {inverted} inverted cells"]

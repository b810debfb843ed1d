"""The motion as a function of PyTorch, with forward and reverse derivatives. Needs ``mesh-motion-client[torch]``.

::

    from mesh_motion_client.torch import Motion

    motion = Motion(session)
    displacement = motion(boundary)         # (n, d) of all nodes for (k, d) of session.moving_nodes, float64
    objective(points + displacement).backward()

A derivative includes the correction of the mesh; there is no second derivative.
"""

from __future__ import annotations

from typing import Any

from mesh_motion_protocol.errors import InvalidInput

try:
    import torch
    from torch.autograd.function import once_differentiable
except ImportError as error:
    raise ImportError(
        f"this needs torch, which cannot be imported: {error} (pip install 'mesh-motion-client[torch]')"
    ) from error

from mesh_motion_client.motion_function import Array, MotionFunction
from mesh_motion_client.session import Session

__all__ = ["Motion"]


class Motion:
    """Displacements of all nodes as a differentiable function of those of the moving nodes.

    Parameters
    ----------
    session : Session
        A session of one partition, with derivatives. Each new argument is a trial of this session; nothing is
        committed.

    Raises
    ------
    InvalidInput
        If the session's method has no derivatives.
    """

    def __init__(self, session: Session) -> None:
        self._motion = MotionFunction(session)

    def __call__(self, displacement: torch.Tensor) -> torch.Tensor:
        """(n, d) tensor of all nodes for the (k, d) ``displacement`` of the moving nodes, float64, any device.

        Raises
        ------
        InvalidInput
            If the tensor is not in double precision, or has another shape.
        QualityRefused
            If no acceptable mesh is found.
        """
        if displacement.dtype != torch.float64:
            raise InvalidInput(
                f"displacement: expected torch.float64, got {displacement.dtype}", hint="give displacement.double()"
            )
        return _Motion.apply(displacement, self._motion)


class _Motion(torch.autograd.Function):
    @staticmethod
    def forward(displacement: torch.Tensor, motion: MotionFunction) -> torch.Tensor:
        return _like(displacement, motion.value(_array(displacement)))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[torch.Tensor, MotionFunction], output: torch.Tensor) -> None:
        del output
        displacement, ctx.motion = inputs
        ctx.save_for_backward(displacement)
        ctx.save_for_forward(displacement)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, weights: torch.Tensor) -> tuple[torch.Tensor, None]:
        (displacement,) = ctx.saved_tensors
        return _like(displacement, ctx.motion.cotangent(_array(displacement), _array(weights))), None

    @staticmethod
    def jvp(ctx: Any, velocity: torch.Tensor, _: None) -> torch.Tensor:
        (displacement,) = ctx.saved_tensors
        return _like(displacement, ctx.motion.tangent(_array(displacement), _array(velocity)))


def _array(tensor: torch.Tensor) -> Array:
    return tensor.detach().cpu().numpy()


def _like(tensor: torch.Tensor, array: Array) -> torch.Tensor:
    """Make a new tensor on the device of another tensor."""
    return torch.tensor(array, device=tensor.device)

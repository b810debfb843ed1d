"""The motion as a function of PyTorch, with forward and reverse derivatives. Needs ``mesh-motion-client[torch]``.

::

    from mesh_motion_client.torch import Motion

    motion = Motion(session)
    displacement = motion(boundary)         # (n, d) of all nodes for (k, d) of session.moving_nodes, float64
    objective(points + displacement).backward()

A derivative includes the correction of the mesh; there is no second derivative. ``torch.func`` works, too: ``jacfwd``
and ``jacrev`` request all columns at once, ``vmap`` of the motion moves the mesh once for each column.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

try:
    import torch
except ImportError as error:
    raise ImportError(
        f"this needs torch, which cannot be imported: {error} (pip install 'mesh-motion-client[torch]')"
    ) from error

from mesh_motion_client.motion_function import Array, MotionFunction, no_second_derivative
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

    def __call__(self, displacement: torch.Tensor | NDArray[np.float64]) -> torch.Tensor:
        """(n, d) tensor of all nodes for the (k, d) ``displacement`` of the moving nodes, float64, any device or array.

        Raises
        ------
        InvalidInput
            If the tensor is not in double precision, or has another shape.
        QualityRefused
            If no acceptable mesh is found.
        """
        displacement = torch.as_tensor(displacement)
        if displacement.dtype != torch.float64:
            raise InvalidInput(
                f"displacement: expected torch.float64, got {displacement.dtype}", hint="give displacement.double()"
            )
        return _Motion.apply(displacement, self._motion)


class _Motion(torch.autograd.Function):
    """The motion. Its derivatives are functions of PyTorch too, so that they work inside ``torch.func``."""

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
    def backward(ctx: Any, weights: torch.Tensor) -> tuple[torch.Tensor, None]:
        return _Derivative.apply(*ctx.saved_tensors, weights, ctx.motion, "cotangent"), None

    @staticmethod
    def jvp(ctx: Any, velocity: torch.Tensor, _: None) -> torch.Tensor:
        return _Derivative.apply(*ctx.saved_tensors, velocity, ctx.motion, "tangent")

    @staticmethod
    def vmap(info: Any, axes: tuple[int, None], displacement: torch.Tensor, motion: Any) -> tuple[torch.Tensor, int]:
        del info
        return torch.stack([_Motion.apply(each, motion) for each in displacement.unbind(axes[0])]), 0


class _Derivative(torch.autograd.Function):
    """J v (``way`` "tangent") or Jᵀ w ("cotangent") at ``displacement`` for one or several vectors (…, m, d).

    It is linear in the vectors, and not differentiated by the displacement.
    """

    @staticmethod
    def forward(displacement: torch.Tensor, vectors: torch.Tensor, motion: MotionFunction, way: str) -> torch.Tensor:
        return _like(vectors, getattr(motion, way)(_array(displacement), _array(vectors)))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
        del output
        displacement, _, ctx.motion, ctx.way = inputs
        ctx.save_for_backward(displacement)
        ctx.save_for_forward(displacement)

    @staticmethod
    def backward(ctx: Any, weights: torch.Tensor) -> tuple[None, torch.Tensor, None, None]:
        if ctx.needs_input_grad[0]:
            raise no_second_derivative()
        other = "cotangent" if ctx.way == "tangent" else "tangent"
        return None, _Derivative.apply(*ctx.saved_tensors, weights, ctx.motion, other), None, None

    @staticmethod
    def jvp(ctx: Any, along: torch.Tensor | None, vectors: torch.Tensor | None, *_: None) -> torch.Tensor:
        if along is not None or vectors is None:
            raise no_second_derivative()
        return _Derivative.apply(*ctx.saved_tensors, vectors, ctx.motion, ctx.way)

    @staticmethod
    def vmap(
        info: Any, axes: tuple[Any, ...], displacement: torch.Tensor, vectors: torch.Tensor, motion: Any, way: str
    ) -> tuple[torch.Tensor, int]:
        """One request for many vectors at one place; one after the other at several places."""
        at, of = axes[:2]
        if at is None and vectors.dim() == 3:
            return _Derivative.apply(displacement, vectors.movedim(of, 0), motion, way), 0
        places = [displacement] * info.batch_size if at is None else displacement.unbind(at)
        given = [vectors] * info.batch_size if of is None else vectors.unbind(of)
        return torch.stack([_Derivative.apply(*pair, motion, way) for pair in zip(places, given, strict=True)]), 0


def _array(tensor: torch.Tensor) -> Array:
    return tensor.detach().cpu().numpy()


def _like(tensor: torch.Tensor, array: Array) -> torch.Tensor:
    """Make a new tensor on the device of another tensor."""
    return torch.tensor(array, device=tensor.device)

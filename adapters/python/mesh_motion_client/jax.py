"""The motion as a function of JAX, with forward and reverse derivatives. Needs ``mesh-motion-client[jax]``.

::

    import jax
    from mesh_motion_client.jax import Motion

    jax.config.update("jax_enable_x64", True)
    motion = Motion(session)                # (n, d) of all nodes for (k, d) of session.moving_nodes, float64
    gradient = jax.grad(lambda boundary: objective(points + motion(boundary)))(boundary)

Compiled code (``jit``) calls the motion back, under ``vmap`` once for each column; the derivative takes all columns at
once (``jacfwd``, ``jacrev``). A derivative includes the correction of the mesh; there is no second derivative. An error
of the server becomes JAX's error of a failed callback, with the server's text.

The derivative is a JAX primitive that is linear in the vector: J v, whose transpose is Jᵀ w.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

try:
    import jax
    import jax.numpy as jnp
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir
except ImportError as error:
    raise ImportError(
        f"this needs jax, which cannot be imported: {error} (pip install 'mesh-motion-client[jax]')"
    ) from error

from mesh_motion_client.motion_function import MotionFunction, no_second_derivative
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
        self._nodes = len(session.points("reference"))

    def __call__(self, displacement: jax.Array) -> jax.Array:
        """(n, d) array of all nodes for the (k, d) ``displacement`` of the moving nodes, float64.

        Raises
        ------
        InvalidInput
            If the array is not in double precision.
        """
        displacement = jnp.asarray(displacement)
        if displacement.dtype != jnp.float64:
            raise InvalidInput(
                f"displacement: expected float64, got {displacement.dtype}",
                hint='call jax.config.update("jax_enable_x64", True) before the first array',
            )
        return _moved(self._motion, self._nodes, displacement)


def _host(call: Any, *arrays: Any) -> Any:
    return call(*(np.asarray(array) for array in arrays))


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _moved(motion: MotionFunction, nodes: int, displacement: Any) -> Any:
    shape = jax.ShapeDtypeStruct((nodes, displacement.shape[-1]), jnp.float64)
    return jax.pure_callback(partial(_host, motion.value), shape, displacement, vmap_method="sequential")


@_moved.defjvp
def _moved_jvp(motion: MotionFunction, nodes: int, at: Any, along: Any) -> Any:
    (displacement,), (velocity,) = at, along
    side = {"rows": nodes, "back": displacement.shape[0]}
    slope = _derivative_p.bind(displacement, velocity, motion=motion, way="tangent", **side)
    return _moved(motion, nodes, displacement), slope


#: J v (way "tangent") or Jᵀ w ("cotangent") at ``displacement`` for one or several vectors (…, m, d). ``rows``: number
#: of rows in each result; ``back``: in each vector.
_derivative_p = Primitive("mesh_motion_derivative")


def _shape(vectors: Any, rows: int) -> Any:
    return (*vectors.shape[:-2], rows, vectors.shape[-1])


def _called(displacement: Any, vectors: Any, *, motion: MotionFunction, way: str, rows: int, back: int) -> Any:
    del back
    result = jax.ShapeDtypeStruct(_shape(vectors, rows), jnp.float64)
    return jax.pure_callback(partial(_host, getattr(motion, way)), result, displacement, vectors)


def _changed(at: Any, along: Any, **kept: Any) -> Any:
    """The derivative is linear in the vectors. It has no derivative with respect to the displacement."""
    if not isinstance(along[0], ad.Zero):
        raise no_second_derivative()
    return _derivative_p.bind(*at, **kept), _derivative_p.bind(at[0], along[1], **kept)


def _transposed(weights: Any, at: Any, _: Any, *, motion: Any, way: str, rows: int, back: int) -> Any:
    if isinstance(weights, ad.Zero):
        return None, weights
    other = "cotangent" if way == "tangent" else "tangent"
    return None, _derivative_p.bind(at, weights, motion=motion, way=other, rows=back, back=rows)


def _batched(arguments: Any, axes: Any, **kept: Any) -> Any:
    """One call for many vectors at one place; one after the other at several places."""
    displacement, vectors = arguments
    at, of = axes
    if at is None and vectors.ndim == 3:
        return _derivative_p.bind(displacement, jnp.moveaxis(vectors, of, 0), **kept), 0
    count = displacement.shape[at] if of is None else vectors.shape[of]
    first = [
        jnp.broadcast_to(each, (count, *each.shape)) if axis is None else jnp.moveaxis(each, axis, 0)
        for each, axis in zip(arguments, axes, strict=True)
    ]
    return jax.lax.map(lambda pair: _derivative_p.bind(*pair, **kept), tuple(first)), 0


_derivative_p.def_impl(partial(jax.jit, static_argnames=("motion", "way", "rows", "back"))(_called))
_derivative_p.def_abstract_eval(
    lambda displacement, vectors, *, rows, **_: jax.core.ShapedArray(_shape(vectors, rows), displacement.dtype)
)
mlir.register_lowering(_derivative_p, mlir.lower_fun(_called, multiple_results=False))
ad.primitive_jvps[_derivative_p] = _changed
ad.primitive_transposes[_derivative_p] = _transposed
batching.primitive_batchers[_derivative_p] = _batched

"""What :mod:`test_motion_function` runs: JAX's own check of the derivatives, and its transformations."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from client_square import square
from jax.test_util import check_grads
from mesh_motion_client import InvalidInput, connect
from mesh_motion_client.jax import Motion
from test_motion_function import SIDE, bulge

POINTS = square(SIDE).points


def objective(motion, at):
    return jnp.sum((POINTS + motion(at)) ** 3)


def gradients_are_those_of_differences(motion):
    """Derivatives of the interpolated motion, and of the corrected one."""
    for size in (0.1, 0.5):
        check_grads(motion, (jnp.asarray(bulge(size)),), 1, ("fwd", "rev"), atol=1e-5, rtol=1e-5, eps=1e-5)


def jacobians_are_the_same_forward_and_reverse(motion):
    at = jnp.asarray(bulge(0.4))
    forward, reverse = jax.jacfwd(motion)(at), jax.jacrev(motion)(at)
    assert forward.shape == (SIDE * SIDE, 2, SIDE, 2)
    np.testing.assert_allclose(forward, reverse, atol=1e-11)


def compiled_is_the_same(motion):
    at = jnp.asarray(bulge(0.4))
    gradient = jax.grad(lambda boundary: objective(motion, boundary))
    np.testing.assert_array_equal(jax.jit(motion)(at), motion(at))
    np.testing.assert_allclose(jax.jit(gradient)(at), gradient(at), rtol=1e-12)


def batches_are_their_members(motion):
    """Several boundaries, and vectors of several boundaries, at once."""
    many = jnp.stack([jnp.asarray(bulge(size)) for size in (0.1, 0.3, 0.5)])
    gradient = jax.grad(lambda boundary: objective(motion, boundary))
    np.testing.assert_allclose(jax.vmap(gradient)(many), [gradient(each) for each in many], rtol=1e-12)
    along = jax.vmap(lambda at, v: jax.jvp(motion, (at,), (v,))[1], in_axes=(1, 0))(jnp.moveaxis(many, 0, 1), many)
    np.testing.assert_allclose(along, [jax.jvp(motion, (each,), (each,))[1] for each in many], rtol=1e-12)


def there_is_no_second_derivative(motion):
    """The derivative is differentiated by its vector alone."""
    at = jnp.asarray(bulge(0.1))
    with pytest.raises(InvalidInput, match="no second derivative"):
        jax.hessian(lambda boundary: objective(motion, boundary))(at)

    def along(v):
        return jax.jvp(motion, (at,), (v,))[1]

    np.testing.assert_array_equal(jax.jvp(along, (at,), (2.0 * at,))[1], along(2.0 * at))


def what_the_server_refuses_is_said(motion):
    with pytest.raises(jax.errors.JaxRuntimeError, match="no valid mesh exists"):
        motion(jnp.asarray(bulge(2.0)))
    with pytest.raises(InvalidInput, match="expected float64, got float32"):
        motion(jnp.asarray(bulge(0.1), dtype=jnp.float32))


CHECKS = (
    gradients_are_those_of_differences,
    jacobians_are_the_same_forward_and_reverse,
    compiled_is_the_same,
    batches_are_their_members,
    there_is_no_second_derivative,
    what_the_server_refuses_is_said,
)

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    with connect() as server, server.open(square(SIDE)) as session:
        for check in CHECKS:
            check(Motion(session))
    sys.stdout.write(f"checked: {len(CHECKS)}\n")

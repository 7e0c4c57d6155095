"""jax: Levenberg-Marquardt of one snapshot, vmapped over all and compiled once; double precision, one processor."""

import os

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import jax
import jax.numpy as jnp
import numpy as np
from rounds import serve

jax.config.update("jax_enable_x64", True)
_STEPS = 50
_SMALLEST_STEP_M = 1e-5
_ROUNDING = 1.0 + 1e-12  # without it, steps at the very minimum are refused and tried again


def _solve_one(start, sensors, bearing, std):
    def errors(point):
        dx, dy = point[0] - sensors[:, 0], point[1] - sensors[:, 1]
        error = jnp.arctan2(dy, dx) - bearing
        scale = 1.0 / (std * (dx * dx + dy * dy))
        return (error - 2.0 * jnp.pi * jnp.round(error / (2.0 * jnp.pi))) / std, -dy * scale, dx * scale

    def normal(point):
        r, a, b = errors(point)
        return jnp.array([r @ r, a @ a, a @ b, b @ b, a @ r, b @ r])

    def step(state):
        count, point, damping, sums, _ = state
        cost, aa, ab, bb, ar, br = sums
        p, q = aa * (1.0 + damping), bb * (1.0 + damping)
        move = jnp.array([ab * br - q * ar, ab * ar - p * br]) / (p * q - ab * ab)
        tried = normal(point + move)
        better = tried[0] <= cost * _ROUNDING
        length = jnp.where(better | (damping > 1e8), jnp.hypot(move[0], move[1]), jnp.inf)
        return (
            count + 1,
            jnp.where(better, point + move, point),
            jnp.where(better, damping * 0.1, damping * 10.0),
            jnp.where(better, tried, sums),
            length,
        )

    def going_on(state):
        return (state[0] < _STEPS) & (state[4] > _SMALLEST_STEP_M)

    first = (0, start, 1e-4, normal(start), jnp.inf)
    _, point, _, sums, length = jax.lax.while_loop(going_on, step, first)
    _, aa, ab, bb, _, _ = sums
    covariance = jnp.array([[bb, -ab], [-ab, aa]]) / (aa * bb - ab * ab)
    return jnp.where(length <= _SMALLEST_STEP_M, point, jnp.nan), covariance


_solve_all = jax.jit(jax.vmap(_solve_one))


def solve(problems):
    """Return all fixes; covariances are made too."""
    names = ("start_m", "sensor_xy_m", "bearing_rad", "bearing_std_rad")
    positions, covariances = _solve_all(*(problems[name] for name in names))
    np.asarray(covariances)
    return np.asarray(positions)


if __name__ == "__main__":
    serve(solve)

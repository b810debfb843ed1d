"""Velocities of nodes for a time scheme, from the positions at its time levels; step sizes may vary.

=========  ===========================================================================================================
scheme     velocity at the new level; Δx = x - x₀ since the last level, Δt = t - t₀, ω = Δt / (t₀ - t₋₁)
=========  ===========================================================================================================
"bdf1"     Δx / Δt
"bdf2"     ((1 + 2 ω) Δx - ω² (x₀ - x₋₁)) / ((1 + ω) Δt); the first step, which has no x₋₁, as "bdf1"
"bossak"   γ / (β Δt) Δx + (1 - γ / β) v₀ + (1 - γ / (2 β)) Δt a₀, with a = (v - v₀) / (γ Δt) - (1 - γ) / γ a₀; the
           mesh starts at rest; γ = ½ - α, β = ¼ (1 - α)², α = -0.3
=========  ===========================================================================================================

References
----------
"bdf2": E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., §III.5: variable steps.
"bossak": W. L. Wood, M. Bossak, O. C. Zienkiewicz, An alpha modification of Newmark's method, IJNME 15 (1980), with the
α and the formulas of Kratos' ``CalculateMeshVelocityUtility``.
"""

from __future__ import annotations

from dataclasses import dataclass

from mesh_motion_numerics.arrays import Floats

#: Number of (n, d) arrays of earlier levels that a scheme needs.
STORED_ARRAYS = {"": 0, "bdf2": 1, "bossak": 2}

_ALPHA = -0.3
_GAMMA, _BETA = 0.5 - _ALPHA, 0.25 * (1.0 - _ALPHA) ** 2


@dataclass(frozen=True, eq=False)
class TimeLevel:
    """The time of a committed state, and the data of earlier levels for the velocities of later ones."""

    #: time, previous_time: times of this state and of the one before, seconds; None if not known
    time: float | None = None
    previous_time: float | None = None
    #: tuple of (n, d). For "bdf2" the earlier positions, mesh length unit; for "bossak" the velocities, and the
    #: accelerations. No arrays at the first level.
    arrays: tuple[Floats, ...] = ()


def scheme_velocity(scheme: str, moved: Floats, committed: Floats, level: TimeLevel, time: float) -> Floats:
    """Velocities (n, d) of nodes that have ``moved``, mesh length unit per second.

    Parameters
    ----------
    scheme : {"bdf1", "bdf2", "bossak"}
    moved, committed : (n, d) arrays, mesh length unit
    level : TimeLevel
        Level of ``committed``; its time is known, and it has the arrays of the scheme.
    time : float
        Time of ``moved``, seconds; later than that of the level.
    """
    dt, dx = time - _known(level.time), moved - committed
    if not level.arrays:
        return dx * (_GAMMA / _BETA / dt if scheme == "bossak" else 1.0 / dt)
    if scheme == "bdf2":
        ratio = dt / (_known(level.time) - _known(level.previous_time))
        (before,) = level.arrays
        return ((1.0 + 2.0 * ratio) * dx - ratio**2 * (committed - before)) / ((1.0 + ratio) * dt)
    if scheme == "bossak":
        v, a = level.arrays
        return _GAMMA / (_BETA * dt) * dx + (1.0 - _GAMMA / _BETA) * v + (1.0 - _GAMMA / (2.0 * _BETA)) * dt * a
    return dx / dt


def level_after(stored: str, moved: Floats, committed: Floats, level: TimeLevel, time: float | None) -> TimeLevel:
    """The level of the state at ``moved``; parameters as above, ``stored`` one of :data:`STORED_ARRAYS`."""
    if stored == "bdf2":
        return TimeLevel(time, level.time, (committed,))
    if stored == "bossak":
        v = scheme_velocity("bossak", moved, committed, level, _known(time))
        dt = _known(time) - _known(level.time)
        v0, a0 = level.arrays or (0.0, 0.0)
        return TimeLevel(time, level.time, (v, (v - v0) / (_GAMMA * dt) - (1.0 - _GAMMA) / _GAMMA * a0))
    return TimeLevel(time, level.time)


def _known(time: float | None) -> float:
    if time is None:
        raise ValueError("the time of a level is not known")
    return time

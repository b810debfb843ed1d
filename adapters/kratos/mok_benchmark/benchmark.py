"""The benchmark: a flexible wall in a narrowing channel; Mok (2001).

Lengths in m, x along the channel. The wall stands on the bottom, half as high as the channel; behind it a ramp leads to
the narrow part. The ramp's upper corner is rounded with a radius of 1 m.

References
----------
D. P. Mok, Partitionierte Lösungsansätze in der Strukturdynamik und der Fluid-Struktur-Interaktion, PhD thesis,
Universität Stuttgart, 2001, doi 10.18419/opus-147. G. Valdés, Nonlinear Analysis of Orthotropic Membrane and Shell
Structures Including Fluid-Structure Interaction, PhD thesis, Universitat Politècnica de Catalunya, 2007. The place of
the wall and the rounding are measured from Kratos' own example of the benchmark.
"""

from __future__ import annotations

from typing import Final

from mok_benchmark.parameters import Case

LENGTH: Final = 1.75
HEIGHT: Final = 0.5
OUTLET_FLOOR: Final = 0.3
#: The ramp would end here, were it not rounded.
RAMP_END: Final = 1.3
ROUNDING: Final = 1.0
WALL: Final = (0.4965, 0.5015)
WALL_HEIGHT: Final = 0.25

FLUID_DENSITY: Final = 956.0  # kg/m³
VISCOSITY: Final = 0.145  # kg/(m s)
SOLID_DENSITY: Final = 1500.0
YOUNG: Final = 2.3e6  # Pa
POISSON: Final = 0.45

PEAK_VELOCITY: Final = 0.06067  # m/s, at the top of the inlet
RAMP_TIME: Final = 10.0  # s
CASE: Final = Case(
    no_slip=("bottom",),
    slip=("top",),
    inflow=(
        (f"2*{PEAK_VELOCITY}*(1-cos(pi*t/{RAMP_TIME}))*y*(1-y)", (0.0, RAMP_TIME)),
        (f"4*{PEAK_VELOCITY}*y*(1-y)", (RAMP_TIME, "End")),
    ),
    time_step=0.1,
)
END_TIME: Final = 25.0

#: Reference points: the wall's tip and the middle of its left side.
POINTS: Final = {"A": (WALL[0], WALL_HEIGHT), "B": (WALL[0], WALL_HEIGHT / 2.0)}
#: Largest horizontal displacements in m, read off the published histories.
PUBLISHED: Final = {"Mok (2001)": {"A": 0.0778, "B": 0.0274}, "Valdés (2007)": {"A": 0.0820, "B": 0.0293}}

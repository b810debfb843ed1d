"""Made-up figures of a benchmark's case."""

from benchmarks.scale.figures import Figures, Seconds

FIGURES = Figures(
    nodes=50_000,
    cells=300_000,
    boundary=6000,
    setup=Seconds(0.25, 0.26),
    first=Seconds(0.09, 0.1),
    step=Seconds(0.08, 0.085),
    iteration=Seconds(0.04, 0.041),
    brief=Seconds(0.03, 0.031),
    solve=Seconds(0.05, 0.05),
    displace=Seconds(0.0125, 0.012),
    predict=Seconds(0.011, 0.01),
    judge_brief=Seconds(0.005, 0.004),
    kept_bytes=5_000_000,
    peak_bytes=10_000_000,
    resident_bytes=270_000_000,
    minimum=0.43,
    near_wall=0.44,
    inverted=0,
    boundary_error=5e-14,
    corrected=False,
)

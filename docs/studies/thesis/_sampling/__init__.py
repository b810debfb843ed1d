"""Grouped (sampled) prediction, which the thesis recommends in §6.2.1: predict a sample, the rest only if needed.

================  ============================================================================================
``groups``        neighbouring cells in groups of one size, along a space-filling curve; each inside a ball
``expansion``     the field around a group's centre: Taylor's polynomial, from one evaluation of all its derivatives
``remainder``     bound of the field's distance from that polynomial in the ball
``cell_bounds``   quality of a cell by the polynomial, and the least it can be given the remainder
``prediction``    all of it together: what is certainly good is bounded, everything else is evaluated in full
================  ============================================================================================
"""

from docs.studies.thesis._sampling.prediction import (
    BOUNDS,
    DEFAULT_GROUP_SIZE,
    ExpandableField,
    SampledQuality,
    predict_sampled,
)

__all__ = ["BOUNDS", "DEFAULT_GROUP_SIZE", "ExpandableField", "SampledQuality", "predict_sampled"]

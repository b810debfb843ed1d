"""The Move: interpolate, judge, correct, judge, accept; or lead the mesh there in sub-steps."""

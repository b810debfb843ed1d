"""One motion of the mesh: interpolate, judge, correct, judge, accept; or lead the mesh there in sub-steps."""

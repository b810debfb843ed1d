"""The Move: interpolate, predict, correct, accept; large motions in sub-steps."""

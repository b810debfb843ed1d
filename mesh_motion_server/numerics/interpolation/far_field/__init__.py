"""Sums over far centres through polynomials in boxes of points, within a bound that is known beforehand.

``derivative_bounds`` says how fast a basis function's derivatives fall with the distance; ``box_tree`` sorts points
and centres into boxes; ``plan`` decides for each box of points and box of centres which polynomial is good enough;
``far_sum`` has them summed, carried down and evaluated; ``evaluator`` is what a motion evaluates its interpolants with.
"""

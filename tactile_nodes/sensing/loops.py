"""Inner loops compiled by numba: the arithmetic of the numpy code beside which they stand, several times as fast.

Signatures are given, so importing this module compiles everything, or loads what an earlier process compiled; nothing
is compiled while frames come. Sums are made in another order than numpy's, so last digits differ.
"""

from tactile_nodes.sensing.loops_axisymmetric import motion_and_slopes, motion_variance
from tactile_nodes.sensing.loops_field import least_squares
from tactile_nodes.sensing.loops_patches import displacement, match
from tactile_nodes.sensing.loops_pictures import common, counted, differences, halved
from tactile_nodes.sensing.loops_response import read as read_response
from tactile_nodes.sensing.loops_stillness import looked, most_away

__all__ = [
    'common',
    'counted',
    'differences',
    'displacement',
    'halved',
    'least_squares',
    'looked',
    'match',
    'most_away',
    'motion_and_slopes',
    'motion_variance',
    'read_response',
]

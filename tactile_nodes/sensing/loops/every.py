"""All compiled loops that other modules call.

The loops have signatures, so importing this module compiles them, or loads them from the cache. Nothing is compiled
while frames arrive. Sums are in another order than in numpy, so last digits differ.
"""

from tactile_nodes.sensing.loops.axisymmetric import add_by_sides, motion_and_slopes, motion_variance
from tactile_nodes.sensing.loops.field import field
from tactile_nodes.sensing.loops.patches import displacement, match
from tactile_nodes.sensing.loops.pictures import common, counted, differences, halved
from tactile_nodes.sensing.loops.response import read as read_response
from tactile_nodes.sensing.loops.stillness import looked, most_away
from tactile_nodes.sensing.loops.sums import sums
from tactile_nodes.sensing.loops.weights import weighed

__all__ = [
    'add_by_sides',
    'common',
    'counted',
    'differences',
    'displacement',
    'field',
    'halved',
    'looked',
    'match',
    'most_away',
    'motion_and_slopes',
    'motion_variance',
    'read_response',
    'sums',
    'weighed',
]

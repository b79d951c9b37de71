"""Numbers of rows for callers that still count."""

from cable_envs.effects.lanes import SENSE as _SENSE
from cable_envs.effects.lanes import STATES

SENSE = _SENSE.names
S_DELAY, S_BIAS, S_SCALE, S_RECTIFICATION = range(4)
ROWS_S = STATES.count

"""Gymnasium's spaces of an environment, for one alone and for a batch."""

import numpy as np
from gymnasium import spaces

from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import OBSERVATION_LIMIT


def make_spaces(setup: Setup) -> tuple[spaces.Box, spaces.Box]:
    """Observation space and action space of one environment.

    Parameters
    ----------
    setup : Setup
        What defines the environment.

    Returns
    -------
    observation : gymnasium.spaces.Box
        Shape (channels,), float32, within +/- `cable_envs.sim.tasks.OBSERVATION_LIMIT`.
    action : gymnasium.spaces.Box
        Shape (1,), or (2,) in an action mode with a second command, float32, within [-1, 1].

    Examples
    --------
    >>> from cable_envs.sim.setup import make_setup
    >>> make_spaces(make_setup("CableHole-Position", "sine"))
    (Box(-100.0, 100.0, (10,), float32), Box(-1.0, 1.0, (1,), float32))
    """
    shape = (len(setup.channels),)
    observation = spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, shape, np.float32)
    return observation, spaces.Box(-1.0, 1.0, (len(setup.ranges),), np.float32)


def wanted_shape(setup: Setup, num_envs: int = 0) -> str:
    """The shape of an action, or of those of a batch, with what the numbers are where there are two.

    Examples
    --------
    >>> from cable_envs.sim.setup import make_setup
    >>> wanted_shape(make_setup("AntagonistJoint-Position", "sine", action_mode="position_and_co_contraction"), 3)
    '(3, 2) (position, co_contraction)'
    """
    mode, shape = setup.action_mode, (len(setup.ranges),)
    names = f" ({mode.of}, {mode.second.name})" if mode.of and mode.second is not None else ""
    return f"{(num_envs, *shape) if num_envs else shape}{names}"

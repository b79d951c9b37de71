"""A step of one environment, from an action to what Gymnasium's ``step`` returns, spelled out for the names it has."""

from collections.abc import Callable
from typing import Any

import numpy as np

from cable_envs.core.kernels import handed
from cable_envs.sim.buffers import Buffers

Transition = tuple[np.ndarray, float, bool, bool, dict[str, float]]


def transition(
    names: tuple[str, ...], kernel: Callable[..., tuple], buffers: Buffers, ended: Callable[[], None]
) -> Callable[[float], Transition]:
    """A step of one environment without checks: from an action to what Gymnasium's ``step`` returns.

    Parameters
    ----------
    names : tuple of str
        Keys of the info.
    kernel : callable
        (block, obs, common, action) -> (reward, terminated, truncated, *values of the info).
    buffers : Buffers
        Those of the environment.
    ended : callable
        Called where the episode ends.

    Notes
    -----
    It is spelled out for the names there are, as `collections.namedtuple` does it. The info is the dictionary of the
    attributes of an object: these have their places from one step to the next, so that no name is hashed; a dictionary
    display takes more than twice as long, a third of a microsecond more.
    """
    if not all(name.isidentifier() for name in names):
        raise ValueError(f"info names must be identifiers: {names}")
    values = ", ".join(f"info.{name}" for name in names)
    text = f"""def make(kernel, block, obs, common, copy, Info, ended):
    def transition(action):
        info = Info()
        reward, terminated, truncated, {values} = kernel(block, obs, common, action)
        if terminated or truncated:
            ended()
        return copy(), reward, terminated, truncated, info.__dict__
    return transition"""
    space: dict[str, Any] = {}
    exec(text, space)
    b = buffers
    arrays = map(handed, (b.block, b.obs, b.common))
    made = space["make"](kernel, *arrays, b.obs[0].copy, type("Info", (), {}), ended)
    made.buffers = b  # the kernel has addresses only
    return made

"""What decides in an episode: a reference controller in SI, or a trained policy on observations."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import REFERENCE, REFERENCE_ACCELERATION, REFERENCE_RATE


class Actor(Protocol):
    """Two calls: `start` once after every reset, `act` once for every step."""

    def start(self, env: Any) -> None:
        """Begin an episode of the (unwrapped) environment, which has just been reset."""

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        """Action, [1] or [2] as the environment has it, in [-1, 1] for an observation at time t [s]."""


class ControllerActor:
    """A controller in SI behind an environment's observation and action.

    Measurements are the observation times the channels' scales; the command is mapped linearly to the action, and what
    lies outside the action mode's range is clipped by the environment.

    Parameters
    ----------
    controller : object
        One of `baselines`, or any object with its ``reset()``, ``act(t, y, ref)`` and, where it is told the true
        parameters of an episode's rig, ``set_rig(rig)``.
    setup : Setup
        The environment's: its channels, scales and the command's range.
    """

    def __init__(self, controller: Any, setup: Setup):
        self.controller = controller
        self._low, self._span = setup.low, setup.high - setup.low
        self._names = [c.name for c in setup.channels]
        self._scales = np.array([c.scale for c in setup.channels])
        names = [c.name for c in setup.channels]
        self._reference = [names.index(r) for r in (REFERENCE, REFERENCE_RATE, REFERENCE_ACCELERATION)]

    def start(self, env: Any) -> None:
        if hasattr(self.controller, "set_rig"):
            self.controller.set_rig(env.true_rig)
        self.controller.reset()

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        values = (observation * self._scales).tolist()
        r, rate, acceleration = (values[k] for k in self._reference)
        u = self.controller.act(t, dict(zip(self._names, values, strict=True)), (r, rate, acceleration))
        return np.array([2.0 * (u - self._low) / self._span - 1.0], dtype=np.float32)


def controller_actor(name: str, gains: Mapping[str, Any], believed: Setup, acting: Setup) -> ControllerActor:
    """A reference controller that takes the rig of one setup for the true one and acts in another.

    Parameters
    ----------
    name : str
        Of the controller (`cable_envs.baselines`).
    gains : mapping
        By name; its defaults for what is missing.
    believed, acting : Setup
        The setup whose rig it is told, and that of the environment.

    Returns
    -------
    ControllerActor
    """
    from cable_envs.baselines import make_controller

    case = (believed.plant.name, believed.action_mode.name, believed.task.kind)
    return ControllerActor(make_controller(name, *case, believed.rig.values, believed.control_period, **gains), acting)


class ObservationActor:
    """A policy without memory of ours: it is handed the environment's observation as numbers and answers one action.

    Parameters
    ----------
    policy : object
        With ``reset()`` and ``act_observation(t, obs)``: ``obs`` a list of floats, the answer a float in [-1, 1].
    """

    def __init__(self, policy: Any):
        self.policy = policy

    def start(self, env: Any) -> None:
        if hasattr(self.policy, "set_rig"):
            self.policy.set_rig(env.true_rig)
        self.policy.reset()

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        return np.array([self.policy.act_observation(t, observation.tolist())], dtype=np.float32)


class PolicyActor:
    """A trained policy, asked deterministically.

    Parameters
    ----------
    policy : object
        With ``predict(observation, state, episode_start, deterministic) -> (action, state)``, as stable-baselines3's.
    """

    def __init__(self, policy: Any):
        self.policy = policy

    def start(self, env: Any) -> None:
        self._state, self._first = None, True

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        action, self._state = self.policy.predict(
            observation, state=self._state, episode_start=np.array([self._first]), deterministic=True
        )
        self._first = False
        return np.asarray(action, dtype=np.float32).reshape(-1)

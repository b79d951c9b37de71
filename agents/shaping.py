"""What lies between an environment and the network: the same arithmetic in training and when a saved policy acts.

plain      action = last + (1 - smoothing) (asked - last); the last action of a new episode is the one at rest
residual   action = base + share r,  r = last r + (1 - smoothing) (asked - last r), 0 in a new episode

With ``first_frame`` the measurements at the start of the episode stay in view: there the output is known, so they show
how drive and output stand to each other, which no later measurement on the drive side does.

``base`` is what a reference controller of `baselines` answers to the same observation. The network sees it as one more
channel, so that it need not guess the controller's state (Johannink et al. 2019, Silver et al. 2018).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cable_envs.baselines import make_controller
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import COMMAND, REFERENCE, REFERENCE_ACCELERATION, REFERENCE_RATE

BASE_CHANNEL = "base_action"
"""Name of the channel that shows the base controller's action."""


@dataclass(frozen=True)
class Residual:
    """A reference controller whose action is corrected.

    Attributes
    ----------
    controller : str
        Name of the controller (`cable_envs.baselines.CONTROLLERS`).
    share : float
        Largest correction, over half the range of actions.
    gains : mapping
        Gains of the controller that differ from its defaults.
    """

    controller: str
    share: float
    gains: Mapping[str, Any] = field(default_factory=dict)


class Shaping:
    """What lies between n environments with one `Setup` and the network; rows of all arrays are environments.

    For every episode call `begin`, for every later observation `advance`. Then `view` is what the network sees, and
    `apply` turns its answer into the action.

    Parameters
    ----------
    setup : Setup
        What defines the environments.
    n : int
        Number of environments.
    smoothing : float
        Share of the last action that is kept at every step, in [0, 1).
    residual : Residual, optional
        Controller whose action is corrected.
    first_frame : bool
        Whether the measurements at the start of the episode stay in view.

    Attributes
    ----------
    extra_channels : tuple of str
        Names of the channels that `view` adds.
    """

    def __init__(
        self, setup: Setup, n: int, smoothing: float = 0.0, residual: Residual | None = None, first_frame: bool = False
    ):
        self._smoothing = smoothing
        self._measured = [k for k, c in enumerate(setup.channels) if c.measured] if first_frame else []
        self._first = np.zeros((n, len(self._measured)), dtype=np.float32)
        first = tuple(f"first_{setup.channels[k].name}" for k in self._measured)
        self.extra_channels = first if residual is None else (*first, BASE_CHANNEL)
        place = [c.name for c in setup.channels].index(COMMAND)
        self._commands = slice(place, place + len(setup.ranges))  # that of a second action is behind the first
        ends = zip(setup.ranges, setup.channels[self._commands], strict=True)
        told = [(2.0 * c.scale / (high - low), -2.0 * low / (high - low) - 1.0) for (low, high), c in ends]
        self._gain, self._offset = np.array(told).T
        self._base = None if residual is None else _Base(setup, n, residual)
        self._share = 0.0 if residual is None else residual.share
        self._last = np.zeros((n, len(setup.ranges)), dtype=np.float32)
        self._everyone = np.arange(n)

    def begin(self, observation: np.ndarray, lanes: np.ndarray | None = None) -> None:
        """Begin episodes.

        Parameters
        ----------
        observation : ndarray, shape (m, channels)
            First observations of these episodes.
        lanes : ndarray of int, shape (m,), optional
            Environments where they begin; by default all.
        """
        chosen = self._everyone if lanes is None else lanes
        if self._measured:
            self._first[chosen] = observation[:, self._measured]
        if self._base is None:
            at_rest = self._gain * observation[:, self._commands] + self._offset
            self._last[chosen] = np.clip(at_rest, -1.0, 1.0)
        else:
            self._last[chosen] = 0.0
            self._base.begin(observation, chosen)

    def advance(self, observation: np.ndarray, lanes: np.ndarray | None = None) -> None:
        """Take the next observation: the base controller, where there is one, decides.

        Parameters
        ----------
        observation : ndarray, shape (m, channels)
            As the environments give it.
        lanes : ndarray of int, shape (m,), optional
            Environments that it is from; by default all.
        """
        if self._base is not None:
            self._base.advance(observation, self._everyone if lanes is None else lanes)

    def view(self, observation: np.ndarray, lanes: np.ndarray | None = None) -> np.ndarray:
        """What the network sees.

        Parameters
        ----------
        observation : ndarray, shape (m, channels)
            As the environments give it.
        lanes : ndarray of int, shape (m,), optional
            Environments that it is from; by default all.

        Returns
        -------
        ndarray of float32, shape (m, channels + extra_channels)
            ``observation`` itself where no channels are added.
        """
        if not self.extra_channels:
            return observation
        more = [self._first] if self._base is None else [self._first, self._base.action]
        return np.concatenate([observation, *(m if lanes is None else m[lanes] for m in more)], axis=1)

    def apply(self, asked: np.ndarray) -> np.ndarray:
        """The action of every environment.

        Parameters
        ----------
        asked : ndarray, shape (n, actions)
            The answer of the network; what is beyond [-1, 1] is clipped.

        Returns
        -------
        ndarray of float32, shape (n, actions)
            Within [-1, 1], smoothed and added to the base controller's action (equations at the head of this module).
        """
        clipped = np.minimum(np.maximum(asked, -1.0), 1.0)  # np.clip takes twice as long
        self._last = np.asarray(self._smoothing * self._last + (1.0 - self._smoothing) * clipped, dtype=np.float32)
        if self._base is None:
            return self._last
        action = self._base.action + np.float32(self._share) * self._last
        return np.minimum(np.maximum(action, np.float32(-1.0)), np.float32(1.0))

    def state(self) -> dict[str, Any]:
        """Everything that changes, not copied: take a copy before going on."""
        base = None if self._base is None else self._base.__dict__
        return {"last": self._last, "first": self._first, "base": base}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a copy of a `state` of a shaping with the same arguments."""
        self._last, self._first = state["last"].copy(), state["first"].copy()
        if self._base is not None:
            self._base.__dict__.update(state["base"])


class _Base:
    """One controller for each environment, as `cablebench.run.actors.ControllerActor` runs a single one."""

    def __init__(self, setup: Setup, n: int, residual: Residual):
        case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
        self._controllers = [
            make_controller(residual.controller, *case, setup.rig.values, setup.control_period, **residual.gains)
            for _ in range(n)
        ]
        self._low, self._span, self._period = setup.low, setup.high - setup.low, setup.control_period
        self._names = [c.name for c in setup.channels]
        self._scales = np.array([c.scale for c in setup.channels])
        self._reference = [self._names.index(r) for r in (REFERENCE, REFERENCE_RATE, REFERENCE_ACCELERATION)]
        self._steps = [0] * n
        self.action = np.zeros((n, 1), dtype=np.float32)
        """what the controllers ask for now, within [-1, 1]"""

    def begin(self, observation: np.ndarray, lanes: Sequence[int] | np.ndarray) -> None:
        for lane in lanes:
            self._controllers[lane].reset()
            self._steps[lane] = -1
        self.advance(observation, lanes)

    def advance(self, observation: np.ndarray, lanes: Sequence[int] | np.ndarray) -> None:
        r, rate, acceleration = self._reference
        answers = []
        for lane, y in zip(lanes, (observation * self._scales).tolist(), strict=True):
            self._steps[lane] += 1
            t = self._steps[lane] * self._period
            measured = dict(zip(self._names, y, strict=True))
            u = self._controllers[lane].act(t, measured, (y[r], y[rate], y[acceleration]))
            answers.append(2.0 * (u - self._low) / self._span - 1.0)
        self.action[lanes, 0] = np.minimum(np.maximum(answers, -1.0), 1.0)

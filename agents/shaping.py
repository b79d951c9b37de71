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

from baselines import make_controller
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import COMMAND, REFERENCE, REFERENCE_ACCELERATION, REFERENCE_RATE

BASE_CHANNEL = "base_action"
"""Name of the channel that shows the base controller's action."""


@dataclass(frozen=True)
class Residual:
    """A reference controller whose action is corrected by at most ``share`` of the action range's half."""

    controller: str
    share: float
    gains: Mapping[str, Any] = field(default_factory=dict)


class Shaping:
    """For ``n`` environments with one `Setup`; rows of all arrays are environments.

    For every episode `begin`, for every later observation `advance`; then `view` is what the network sees and `apply`
    turns its answer into the action.
    """

    def __init__(
        self, setup: Setup, n: int, smoothing: float = 0.0, residual: Residual | None = None, first_frame: bool = False
    ):
        self._smoothing = smoothing
        self._measured = [k for k, c in enumerate(setup.channels) if c.measured] if first_frame else []
        self._first = np.zeros((n, len(self._measured)), dtype=np.float32)
        first = tuple(f"first_{setup.channels[k].name}" for k in self._measured)
        self.extra_channels = first if residual is None else (*first, BASE_CHANNEL)
        """names of the channels that `view` adds"""
        self._channel = [c.name for c in setup.channels].index(COMMAND)
        span = setup.high - setup.low
        self._gain, self._offset = 2.0 * setup.channels[self._channel].scale / span, -2.0 * setup.low / span - 1.0
        self._base = None if residual is None else _Base(setup, n, residual)
        self._share = 0.0 if residual is None else residual.share
        self._last = np.zeros((n, 1), dtype=np.float32)
        self._everyone = np.arange(n)

    def begin(self, observation: np.ndarray, lanes: np.ndarray | None = None) -> None:
        """Episodes start in ``lanes`` (default all) with ``observation`` [len(lanes), channels]."""
        chosen = self._everyone if lanes is None else lanes
        if self._measured:
            self._first[chosen] = observation[:, self._measured]
        if self._base is None:
            at_rest = self._gain * observation[:, self._channel : self._channel + 1] + self._offset
            self._last[chosen] = np.clip(at_rest, -1.0, 1.0)
        else:
            self._last[chosen] = 0.0
            self._base.begin(observation, chosen)

    def advance(self, observation: np.ndarray, lanes: np.ndarray | None = None) -> None:
        """The next observation in ``lanes``: the base controller, where there is one, decides."""
        if self._base is not None:
            self._base.advance(observation, self._everyone if lanes is None else lanes)

    def view(self, observation: np.ndarray, lanes: np.ndarray | None = None) -> np.ndarray:
        """What the network sees, [len(lanes), channels + extra_channels] float32."""
        if not self.extra_channels:
            return observation
        more = [self._first] if self._base is None else [self._first, self._base.action]
        return np.concatenate([observation, *(m if lanes is None else m[lanes] for m in more)], axis=1)

    def apply(self, asked: np.ndarray) -> np.ndarray:
        """The environment's action [n, 1] when the network asks for ``asked``; within [-1, 1], float32."""
        clipped = np.minimum(np.maximum(asked, -1.0), 1.0)  # np.clip takes twice as long
        self._last = np.asarray(self._smoothing * self._last + (1.0 - self._smoothing) * clipped, dtype=np.float32)
        if self._base is None:
            return self._last
        action = self._base.action + np.float32(self._share) * self._last
        return np.minimum(np.maximum(action, np.float32(-1.0)), np.float32(1.0))

    def state(self) -> dict[str, Any]:
        """All that changes; take a copy of what it holds before going on."""
        base = None if self._base is None else self._base.__dict__
        return {"last": self._last, "first": self._first, "base": base}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to a copied `state`."""
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

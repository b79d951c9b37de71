"""Single environments: Gymnasium around a `Simulation` of one."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from cable_envs.effects import Effect
from cable_envs.sim.buffers import Buffers
from cable_envs.sim.rigs import Rig
from cable_envs.sim.setup import Setup, make_setup
from cable_envs.sim.simulation import Simulation
from cable_envs.sim.tasks import OBSERVATION_LIMIT

if TYPE_CHECKING:
    from cable_envs.render import Renderer


def make_spaces(setup: Setup) -> tuple[spaces.Box, spaces.Box]:
    """(observation space, action space) of one environment."""
    shape = (len(setup.channels),)
    observation = spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, shape, np.float32)
    return observation, spaces.Box(-1.0, 1.0, (1,), np.float32)


Transition = tuple[np.ndarray, float, bool, bool, dict[str, float]]


def _transition(
    names: tuple[str, ...], kernel: Callable[..., tuple], buffers: Buffers
) -> Callable[[float], Transition]:
    """A step without checks: from an action to what `CableEnv.step` returns.

    Parameters
    ----------
    names : tuple of str
        Keys of the info.
    kernel : callable
        (block, obs, common, action) -> (reward, terminated, truncated, *values of the info).
    buffers : Buffers
        Those of the environment.

    Notes
    -----
    It is spelled out for the names there are, as `collections.namedtuple` does it. The info is the dictionary of the
    attributes of an object: these have their places from one step to the next, so that no name is hashed; a dictionary
    display takes more than twice as long, a third of a microsecond more.
    """
    if not all(name.isidentifier() for name in names):
        raise ValueError(f"info names must be identifiers: {names}")
    values = ", ".join(f"info.{name}" for name in names)
    text = f"""def make(kernel, block, obs, common, copy, Info):
    def transition(action):
        info = Info()
        reward, terminated, truncated, {values} = kernel(block, obs, common, action)
        return copy(), reward, terminated, truncated, info.__dict__
    return transition"""
    space: dict[str, Any] = {}
    exec(text, space)
    b = buffers
    return space["make"](kernel, b.block, b.obs, b.common, b.obs[0].copy, type("Info", (), {}))


def _not_reset(action: float) -> Transition:
    raise gym.error.ResetNeeded("call reset() before the first step() of an episode")


class CableEnv(gym.Env[np.ndarray, np.ndarray]):
    """Tension or position control of a cable mechanism.

    ### Tasks

    | id (``cable_envs/...``)           | controlled output           | rig         | action (default mode)          |
    |-----------------------------------|-----------------------------|-------------|--------------------------------|
    | CableHole-Position-{Step,Sine}-v0 | load position [m]           | gu-inferred | driving tension 0..120 N       |
    | CableHole-Tension-{Step,Sine}-v0  | load-side tension [N]       | gu-anchored | driving tension 0..120 N       |
    | PulleyCircuit-Position-{..}-v0    | angle of driven pulley [rad]| zou-table2  | drive angle +/- limit [rad]    |
    | PulleyCircuit-Torque-{..}-v0      | grasp torque [N m]          | zou-grasp   | motor torque +/- limit [N m]   |

    ### Spaces

    action: ``Box(-1, 1, (1,))``, linear over the range of the action mode. observation: float32 vector, entry k is the
    SI value of ``env.unwrapped.channels[k]`` over its scale, limited to +/- 100: the reference with two derivatives,
    the tracking error (through the rigid transmission ratio where the output is not observed), the last command, then
    the observed signals of the plant.

    ### Reward, end

    ``1 / (1 + |error| / error_scale) - effort_weight (a - a_previous)^2`` with the true output. Terminated when the
    cable tears (peak tension above ``breaking_tension``) or the state is not finite; truncated after ``duration``.

    ### Arguments (all optional)

    | name           | meaning                                                                              |
    |----------------|--------------------------------------------------------------------------------------|
    | rig            | preset name, YAML path, full mapping, or mapping of parameters to change             |
    | effects        | physics besides: ``{"backlash": {"gap": 0.02}}`` (`cable_envs.effects`, ``EFFECTS``)   |
    | effect_file    | a Python file with an effect of one's own (`cable_envs.plants.own_effects`)                 |
    | plant          | "analytic" or "chain" (pulley circuit: span-and-contact chain)                       |
    | action_mode    | hole: "tension", "speed"; circuit: "position", "torque"                              |
    | observe        | "drive", "output", "full"; the circuit's default is "drive", the hole's "output"     |
    | reference      | mapping such as ``{"kind": "multisine", "amplitude": 0.01, "frequency": 0.1}``       |
    | randomize      | True (the task's ranges) or ``{parameter: {"scale": [a, b]}}`` or ``{low, high}``;   |
    |                | a parameter may be an effect's ("backlash.gap")                                      |
    | sensor_noise   | True, a factor on the task's standard deviations, or ``{signal: std in SI}``         |
    | sensor_delay   | control steps by which measurements are late (the reference and the command are not) |
    | action_delay   | control steps until an action acts                                                   |
    | disturbance    | a reference-like mapping: force on the load [N] or torque on the output [N m]        |
    | control_period | s, default 0.01                                                                      |
    | substeps       | integration steps in a control period, default 20 (0.5 ms)                           |
    | duration       | s, default 20 (hole) and 25 (circuit)                                                |
    | render_mode    | "rgb_array" or "human"                                                               |

    ``reset(options=...)`` takes "rig" (parameters for this episode), "reference", "disturbance", "initial_position".

    ### Info (floats, at every step)

    time, reference, output, error, command, overload (1 above ``tension_limit``), and every signal of the plant.

    ### Versions

    v0: first release.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 50}  # noqa: RUF012 (Gymnasium's convention)

    def __init__(
        self,
        task: str,
        reference: str | Mapping[str, Any],
        *,
        rig: str | Path | Mapping[str, Any] | Rig | None = None,
        effects: Mapping[str, Any] | None = None,
        effect_file: str | Path | Effect | None = None,
        plant: str = "analytic",
        action_mode: str | None = None,
        observe: str | None = None,
        randomize: bool | Mapping[str, Any] = False,
        sensor_noise: bool | float | Mapping[str, float] = False,
        sensor_delay: int = 0,
        action_delay: int = 0,
        disturbance: Mapping[str, Any] | None = None,
        control_period: float | None = None,
        substeps: int | None = None,
        duration: float | None = None,
        render_mode: str | None = None,
        **unknown: Any,
    ):
        self.setup = make_setup(
            task, reference, rig=rig, effects=effects, effect_file=effect_file, plant=plant, action_mode=action_mode,
            observe=observe, randomize=randomize, sensor_noise=sensor_noise, sensor_delay=sensor_delay,
            action_delay=action_delay, disturbance=disturbance, control_period=control_period, substeps=substeps,
            duration=duration, **unknown,
        )  # fmt: skip
        self.render_mode = render_mode
        self.observation_space, self.action_space = make_spaces(self.setup)
        self.channels = self.setup.channels
        self.simulation = Simulation(self.setup, 1)
        self._lane = np.zeros(1, dtype=np.int64)
        self._obs, self._table = self.simulation.buffers.obs[0], self.simulation.buffers.table[:, 0]
        self._transition: Callable[[float], Transition] = _not_reset
        self._kernel: Callable[..., None] | None = None
        self._renderer: Renderer | None = None

    @property
    def true_rig(self) -> dict[str, float]:
        """Parameters of the simulated rig in this episode, SI: what only an oracle may know."""
        return self.simulation.lane_rig(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, float]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the environment's own generator; without one it goes on drawing.
        options : dict, optional
            What this episode has otherwise than the environment: "rig" (parameters to change), "reference",
            "disturbance" (mappings), "initial_position" (of the output, SI).

        Returns
        -------
        observation : ndarray, shape (channels,), float32
            Measurements over their scales.
        info : dict
            SI numbers of this instant, with the same keys at every step.

        Raises
        ------
        ConfigurationError
            For options that do not exist or do not fit the environment.
        """
        super().reset(seed=seed)
        self.simulation.reset(self._lane, [self.np_random], options)
        if self.simulation.kernel is not self._kernel:  # the first episode, or the first with effects
            self._kernel = self.simulation.kernel
            self._transition = _transition(
                self.simulation.info_names, self.simulation.single_kernel(), self.simulation.buffers
            )
        if self._renderer is not None:
            self._renderer.reset()
        info = dict(zip(self.simulation.info_names, self._table.tolist(), strict=True))
        if self.render_mode is not None:
            self._draw(info)
        return self._obs.copy(), info

    def step(self, action: np.ndarray) -> Transition:
        """Go on by one control period.

        Parameters
        ----------
        action : ndarray, shape (1,)
            Command over its range, in [-1, 1]; what is beyond is clipped.

        Returns
        -------
        observation : ndarray, shape (channels,), float32
        reward : float
        terminated : bool
            The cable broke or left its limits.
        truncated : bool
            The episode's time is over.
        info : dict
            SI numbers of this instant.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before `reset`, and after the end of an episode.
        ValueError
            For an action of another shape or that is no finite number.
        """
        try:
            (value,) = action.tolist()
            fine = -1e30 < value < 1e30
        except (AttributeError, TypeError, ValueError):
            fine = False
        result = self._transition(value if fine else self._checked(action))
        if self.render_mode is not None:
            self._draw(result[4])
        return result

    def _checked(self, action: Any) -> float:
        """An action that is no array of one number in range: as a number, or the error that it makes."""
        if self._kernel is None:
            _not_reset(0.0)
        action = np.asarray(action)
        if action.shape != (1,):
            raise ValueError(f"action must have shape (1,), got {action.shape}")
        value = action.item()
        if not -1e30 < value < 1e30:
            raise ValueError(f"action must be a finite number in [-1, 1], got {value}")
        return value

    def _draw(self, info: Mapping[str, float]) -> None:
        if self._renderer is None:
            from cable_envs.render import Renderer

            self._renderer = Renderer.for_setup(self.setup, str(self.render_mode))
        self._renderer.push(info, info["time"], info["reference"], info["output"])
        if self.render_mode == "human":
            self._renderer.show()

    def render(self) -> np.ndarray | None:
        """The scene now as RGB [height, width, 3] where ``render_mode`` is "rgb_array", else nothing."""
        if self.render_mode is None:
            gym.logger.warn("render() does nothing without render_mode; use gym.make(id, render_mode='rgb_array')")
            return None
        if self._renderer is None:
            raise gym.error.ResetNeeded("call reset() before render()")
        return self._renderer.frame() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, where there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

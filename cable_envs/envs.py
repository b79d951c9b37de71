"""Single environments: Gymnasium around a `Simulation` of one."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from cable_envs.effects import Effect
from cable_envs.plants import VERSIONS
from cable_envs.sim.registered import described
from cable_envs.sim.rigs import Rig
from cable_envs.sim.setup import make_setup
from cable_envs.sim.simulation import Simulation, generator_of
from cable_envs.sim.transition import Transition, transition
from cable_envs.spaces import make_spaces, wanted_shape

if TYPE_CHECKING:
    from cable_envs.render import Renderer


def _not_reset(action: float) -> Transition:
    raise gym.error.ResetNeeded("call reset() before the first step() of an episode")


_MADE_AGAIN = frozenset((
    "setup", "simulation", "_lane", "_obs", "_table", "_second", "_transition", "_going", "_kernel", "_renderer",
))  # fmt: skip
"""Attributes that a copy makes for itself."""


class CableEnv(gym.Env[np.ndarray, np.ndarray]):
    """Tension or position control of a cable mechanism.

    ## Description

    A drive pulls a cable, which loses tension to friction and stretches on its way to a load. The agent commands the
    drive so that one quantity of the mechanism, the output, follows a reference.

    | id (`cable_envs/...`)             | output                           | rig         | action mode | error_scale |
    |-----------------------------------|----------------------------------|-------------|-------------|-------------|
    | CableHole-Position-{Step,Sine}-v0 | load position [m]                | gu-inferred | tension     | 0.001 m     |
    | CableHole-Tension-{Step,Sine}-v0  | load-side tension [N]            | gu-anchored | tension     | 0.5 N       |
    | PulleyCircuit-Position-{..}-v0    | angle of the driven pulley [rad] | zou-table2  | position    | 0.02 rad    |
    | PulleyCircuit-Torque-{..}-v0      | grasp torque [N m]               | zou-grasp   | torque      | 0.01 N m    |
    | TendonSheath-Position-{..}-v0     | load position [m]                | bowden-1m   | position    | 0.0005 m    |
    | TendonSheath-Tension-{..}-v0      | load-side tension [N]            | bowden-1m   | tension     | 0.5 N       |
    | AntagonistJoint-Position-{..}-v1  | joint angle [rad]                | finger-joint| position    | 0.02 rad    |
    | AntagonistJoint-Torque-{..}-v1    | torque of the tendons [N m]      | finger-grasp| torque      | 0.005 N m   |
    | Wrist-Position-{..}-v1            | angle of the yaw joint [rad]     | wrist-8mm   | position    | 0.02 rad    |
    | LinearDrive-Position-{..}-v1      | position of the carriage [m]     | belt-axis   | force       | 0.001 m     |
    | RotaryJoint-Position-{..}-v1      | angle of the joint [rad]         | geared-arm  | torque      | 0.01 rad    |

    Rig and action mode are the defaults of the task. The tasks of suite v1 (`cable_envs/CableHole-Track-Hard-v1` and
    others, configs/suite) have levels, which say what is drawn for an episode, what sensors show and what ends it.

    ## Action Space

    `Box(-1, 1, (1,), float32)`, linear over the range of the action mode. A value beyond the range is clipped. A mode
    with a second command (its name has "_and_") takes `Box(-1, 1, (2,), float32)`. The parameters of the rig set the
    ranges; with the rig of the task they are:

    | mechanism     | action mode | command         | range             |
    |---------------|-------------|-----------------|-------------------|
    | CableHole     | tension     | driving tension | 0 to 120 N        |
    | CableHole     | speed       | drive speed     | -0.1 to 0.1 m/s   |
    | PulleyCircuit | position    | drive angle     | -3 to 3 rad       |
    | PulleyCircuit | torque      | motor torque    | -0.6 to 0.6 N m   |
    | TendonSheath  | position    | drive position  | -0.05 to 0.05 m   |
    | TendonSheath  | tension     | drive force     | 0 to 80 N         |
    | AntagonistJoint | position  | drives' angle   | -1.5 to 1.5 rad   |
    | AntagonistJoint | torque    | drives' torque  | -0.5 to 0.5 N m   |
    | .._and_co_contraction | second | mean tension | 0 to 40 N         |
    | Wrist         | position    | drive angle     | -2.54 to 2.54 rad |
    | position_and_pitch | second | pitch           | -1.4 to 1.4 rad   |
    | LinearDrive   | force       | motor force     | -150 to 150 N     |
    | LinearDrive   | voltage     | motor voltage   | -10 to 10 V       |
    | LinearDrive   | position    | motor position  | -0.3 to 0.3 m     |
    | RotaryJoint   | torque      | motor torque    | -6 to 6 N m       |
    | RotaryJoint   | current     | motor current   | -4 to 4 A         |
    | RotaryJoint   | voltage     | motor voltage   | -24 to 24 V       |
    | RotaryJoint   | duty        | bridge's duty   | -1 to 1           |
    | RotaryJoint   | position    | angle           | -2 to 2 rad       |

    ## Observation Space

    `Box(-100, 100, (channels,), float32)`. Entry k is the SI value of `env.unwrapped.channels[k]` over its scale,
    limited to +/- 100. `cablebench envs ID` lists the channels of an environment with their units and scales.

    | entry | channel                | value                                                              |
    |-------|------------------------|--------------------------------------------------------------------|
    | 0     | reference              | what the output should be now                                      |
    | 1     | reference_rate         | its first derivative, with the scale of the reference              |
    | 2     | reference_acceleration | its second derivative, with the scale of the reference             |
    | 3     | error                  | reference minus measured output                                    |
    | 4     | command                | what acted in the last control step, in the unit of the action mode|
    | 5..   | signals                | the measured signals of the plant at the level `observe`; before   |
    |       |                        | them a second command, where there is one                          |

    Where the output is not observed, a measured signal of the drive stands for it in the error, through the rigid
    transmission ratio. A level has the signals of the level before it, and more:

    | task                   | "drive"                                       | "output"                      |
    |------------------------|-----------------------------------------------|-------------------------------|
    | CableHole-Position     | drive_position, drive_velocity, drive_tension | load_position, load_velocity  |
    | CableHole-Tension      | drive_position, drive_velocity, drive_tension | load_tension                  |
    | PulleyCircuit-Position | drive_angle, drive_velocity, drive_torque     | output_angle, output_velocity |
    | PulleyCircuit-Torque   | drive_angle, drive_velocity, drive_torque     | output_torque                 |
    | TendonSheath-Position  | drive_position, drive_velocity, drive_tension | load_position, load_velocity  |
    | TendonSheath-Tension   | drive_position, drive_velocity, drive_tension | load_tension                  |
    | AntagonistJoint-Position | drive_angle, drive_torque, co_contraction   | joint_angle, joint_velocity   |
    | AntagonistJoint-Torque | drive_angle, drive_torque, co_contraction     | joint_torque                  |
    | Wrist-Position         | drive_angle, drive_velocity, pitch_drive_angle | yaw_angle, yaw_velocity      |
    | LinearDrive-Position   | motor_position, motor_velocity, force         | position, velocity            |
    | RotaryJoint-Position   | torque, current                               | position, velocity            |

    The level "full" adds the state of the load that "output" leaves out. For the hole it also adds `sliding`, for the
    sheath `mobilised` and `sliding`, for the circuit `phase` and the four tensions of the cable.

    ## Rewards

    `1 / (1 + |error| / error_scale) - effort_weight (a - a_previous)^2` at every step. The error is that of the true
    output, without noise; a is the action that acts; `effort_weight` is 0.05 in every task. Of two actions both
    changes count.

    In suite v1 the error is priced and `effort_weight` is 0: `|error| + error_scale (activity / limit)^2` takes the
    place of `|error|`. The activity is the part of the command above 10 Hz, as a root mean square over half a second
    and a share of the command's range; for 0.3 s after a jump of the reference nothing is added to it. The step that
    breaks a rule for too long earns 0 and is the last (`cable_envs.sim.suite.judging`).

    ## Starting State

    The mechanism is at rest where its output equals the reference at t = 0, or at `initial_position`. The command is
    the one that keeps it there. In suite v1 it is at rest within a range about the reference, which stands still at
    first, and the drive's encoder counts from an unknown zero; a position is commanded from that zero too.

    ## Episode End

    1. Termination: the cable tears, which is when its peak tension in a control step exceeds `breaking_tension`. Of a
       rotary joint nothing tears.
    2. Termination: the state is no longer finite, or the error has reached 1e12.
    3. Termination, in suite v1: a rule of the task was broken for longer than it allows (overload, slack, a dropped
       load, a runaway, the grasp force). `failure` in the info is its number.
    4. Truncation: `duration` is over.

    ## Arguments

    All are optional keywords of `gymnasium.make`.

    | argument       | type                 | default     | meaning                                                |
    |----------------|----------------------|-------------|--------------------------------------------------------|
    | reference      | str or mapping       | that of id  | "step", "sine", or a signal such as                    |
    |                |                      |             | `{"kind": "sine", "amplitude": 0.01, "frequency": 0.1}`|
    |                |                      |             | (`cable_envs.sim.references`); a number may be a range |
    |                |                      |             | that each episode draws from                           |
    |                |                      |             | (`cable_envs.sim.suite.drawing`)                       |
    | level          | str                  | that of id  | of a task of suite v1: what holds for every option     |
    |                |                      |             | that is not given                                      |
    | split          | str                  | "train"     | "train" or "test": whose rigs a level draws            |
    | sensors        | str                  | "rig"       | "ideal" leaves out a level's quantisation, rates,      |
    |                |                      |             | latencies, filters and unknown zero                    |
    | preview        | bool                 | False       | whether a level shows the acceleration of the reference|
    | rig            | str, path or mapping | of the task | preset name, YAML file, whole rig, or parameters to    |
    |                |                      |             | change                                                 |
    | effects        | mapping              | none        | further physics, such as `{"backlash": {"gap": 0.02}}` |
    |                |                      |             | (`cable_envs.effects.EFFECTS`)                         |
    | effect_file    | path or Effect       | none        | an effect of one's own                                 |
    |                |                      |             | (`cable_envs.plants.own_effects`)                      |
    | version        | str                  | that of id  | "v0" or "v1": whose numbers the plant gives            |
    | plant          | str                  | of the rig  | "chain" simulates the pulley circuit as a chain of     |
    |                |                      |             | spans and contacts, "analytic" in closed form; where a |
    |                |                      |             | rig says nothing, in closed form                       |
    | action_mode    | str                  | of the task | one of the action modes above                          |
    | observe        | str                  | of the task | "drive", "output" or "full"; by default "drive" for    |
    |                |                      |             | the circuit and "output" for the others                |
    | randomize      | bool or mapping      | False       | parameters drawn at each reset: True for the ranges of |
    |                |                      |             | the task, `{name: {"scale": [a, b]}}` about the rig, or|
    |                |                      |             | `{name: {"low": a, "high": b}}` in SI; a name may be   |
    |                |                      |             | that of an effect's parameter, as "backlash.gap"       |
    | sensor_noise   | bool, float, mapping | False       | True for the standard deviations of the task, a factor |
    |                |                      |             | on them, or `{signal: standard deviation in SI}`       |
    | sensor_delay   | int                  | 0           | control steps by which measurements are late, at most  |
    |                |                      |             | 100; the reference and the command are not             |
    | action_delay   | int                  | 0           | control steps until an action acts, at most 100        |
    | disturbance    | mapping              | none        | a signal as for the reference: force on the load [N]   |
    |                |                      |             | or torque on the output [N m]                          |
    | posture        | mapping              | none        | a signal as for the reference: how much more a sheath  |
    |                |                      |             | is bent than its rig says [rad]; for rigs whose plant  |
    |                |                      |             | has a posture (a tendon sheath with contacts; a wrist, |
    |                |                      |             | where it is the pitch)                                 |
    | control_period | float                | 0.01        | seconds                                                |
    | substeps       | int                  | 20          | integration steps in a control period, at most 10000   |
    | duration       | float                | of the task | seconds, a multiple of the control period; 25 for the  |
    |                |                      |             | circuit and 20 for the others                          |
    | render_mode    | str                  | none        | "rgb_array", "human" (window), "web" (live page)       |
    | render_theme   | str                  | "light"     | or "dark"; a live page follows the browser as well     |

    `reset(options=...)` takes "rig" (parameters to change), "reference", "disturbance", "posture" (mappings) and
    "initial_position" (of the output, SI) for one episode. An option that does not exist or does not fit raises
    `cable_envs.core.errors.ConfigurationError`, which says what would be right.

    ```python
    >>> import gymnasium
    >>> import cable_envs
    >>> env = gymnasium.make("cable_envs/CableHole-Position-Sine-v0", rig={"load_mass": 4.0}, sensor_noise=True)
    >>> [channel.name for channel in env.unwrapped.channels[:5]]
    ['reference', 'reference_rate', 'reference_acceleration', 'error', 'command']

    ```

    ## Info

    Floats (NumPy's in the info of a reset), with the same keys at every step: time [s], reference, output, error (all
    SI), command (in the unit of the action mode), overload (1 where the peak tension exceeds `tension_limit`, else 0),
    and every signal of the plant. In suite v1 also violations (how many rules are broken now), failure (0, or the
    number of the rule that ended the episode), activity (a share of the command's range) and priced_error (SI).

    ## Vectorized environment

    `gymnasium.make_vec(id, num_envs=n)` makes a `cable_envs.vector.CableVectorEnv`, which steps all environments in one
    call.

    ## Version History

    * v0: first release.
    * v1: the hole's load and drive are stepped together, so that light loads are right; every reported tension obeys
      the contact's law; holes in series are solved together; the step fits the rig, or the rig is refused. The
      circuit's drive is a motor with a servo (rigs zou-table2-motor and zou-grasp-motor). The sheath has 20 contacts,
      and a posture bends it (rig bowden-1m-20). The tasks of suite v1 have levels (docs/suite.md).
    """

    metadata = {"render_modes": ["rgb_array", "human", "web"], "render_fps": 100}  # noqa: RUF012 (Gymnasium's convention)
    _spec: EnvSpec | None = None

    def __init__(
        self,
        task: str,
        reference: str | Mapping[str, Any] | None = None,
        *,
        level: str | None = None,
        split: str = "train",
        sensors: str = "rig",
        preview: bool = False,
        rig: str | Path | Mapping[str, Any] | Rig | None = None,
        effects: Mapping[str, Any] | None = None,
        effect_file: str | Path | Effect | None = None,
        version: str = VERSIONS[-1],
        plant: str | None = None,
        action_mode: str | None = None,
        observe: str | None = None,
        randomize: bool | Mapping[str, Any] | None = None,
        sensor_noise: bool | float | Mapping[str, float] | None = None,
        sensor_delay: int | None = None,
        action_delay: int | None = None,
        disturbance: Mapping[str, Any] | None = None,
        posture: Mapping[str, Any] | None = None,
        control_period: float | None = None,
        substeps: int | None = None,
        duration: float | None = None,
        render_mode: str | None = None,
        render_theme: str = "light",
        **unknown: Any,
    ):
        self._arguments: dict[str, Any] = {
            "task": task, "reference": reference, "level": level, "split": split, "sensors": sensors,
            "preview": preview, "rig": rig, "effects": effects, "effect_file": effect_file, "version": version,
            "plant": plant, "action_mode": action_mode, "observe": observe, "randomize": randomize,
            "sensor_noise": sensor_noise, "sensor_delay": sensor_delay, "action_delay": action_delay,
            "disturbance": disturbance, "posture": posture, "control_period": control_period, "substeps": substeps,
            "duration": duration,
        }  # fmt: skip
        self.setup = make_setup(**self._arguments, **unknown)
        self.render_mode, self.render_theme = render_mode, render_theme
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.setup.control_period)}
        self.observation_space, self.action_space = make_spaces(self.setup)
        self.channels = self.setup.channels
        self._build()

    def _build(self) -> None:
        """What lies in memory that a kernel knows by its address."""
        self.simulation = Simulation(self.setup, 1)
        self._lane = np.zeros(1, dtype=np.int64)
        self._obs, self._table = self.simulation.buffers.obs[0], self.simulation.buffers.table[:, 0]
        self._second = self.simulation.buffers.named.asked_second
        self._plain_below = 1e30 if len(self.setup.ranges) == 1 else -np.inf  # a single number is an action there
        self._transition: Callable[[float], Transition] = _not_reset
        self._going: Callable[[float], Transition] = _not_reset
        self._kernel: Callable[..., None] | None = None
        self._renderer: Renderer | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but what lies in memory that a kernel knows by its address: it is made again."""
        state = {name: value for name, value in self.__dict__.items() if name not in _MADE_AGAIN}
        drawn = self._renderer is not None
        return {**state, "_np_random": self._np_random, "_copied": (self.state(), drawn)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy goes on as the original does, to the bit."""
        copied, drawn = state["_copied"]
        self.__dict__.update({name: value for name, value in state.items() if name != "_copied"})
        self.setup = make_setup(**self._arguments)
        self._build()
        self.restore(copied)
        if drawn:
            self._draw(self._info())

    @property
    def spec(self) -> EnvSpec | None:
        """What Gymnasium knows of the environment, with the length of its episodes (`described`)."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = described(spec, self.setup)

    def state(self) -> dict[str, Any]:
        """Everything that changes from step to step, the random generator included, as copies.

        Returns
        -------
        dict
            What `restore` takes, also that of a `cable_envs.vector.CableVectorEnv`.

        Examples
        --------
        >>> env = CableEnv("CableHole-Position", "sine", sensor_noise=True)
        >>> env.reset(seed=1)[0].shape
        (10,)
        >>> kept = env.state()
        >>> first = env.step(np.array([0.1]))[0]
        >>> env.restore(kept)
        >>> bool((env.step(np.array([0.1]))[0] == first).all())
        True
        """
        drawn = self._np_random
        return {
            "simulation": self.simulation.state(),
            "generators": [None if drawn is None else drawn.bit_generator.state],
            "seeds": [self._np_random_seed],
            "running": self._kernel is not None,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state`: the same actions then give the same trajectory, to the bit.

        Parameters
        ----------
        state : mapping
            A `state` of an environment with the same options, or of one lane of a batch with them.

        Raises
        ------
        ConfigurationError
            Where the state is of other options or of several environments.
        """
        self.simulation.restore(state["simulation"])
        self._np_random, self._np_random_seed = generator_of(state["generators"][0]), state["seeds"][0]
        if state["running"]:
            self._take_kernel()

    def _take_kernel(self) -> None:
        """The step with the simulation's present kernel, or what a step after the end of an episode does."""
        if self.simulation.kernel is not self._kernel:  # the first episode, or the first with effects
            self._kernel = self.simulation.kernel
            names, kernel = self.simulation.info_names, self.simulation.single_kernel()
            self._going = transition(names, kernel, self.simulation.buffers, self._ended)
        self._transition = self._going
        _, terminated, truncated = self.simulation.buffers.outcome[:3, 0]
        if terminated or truncated:
            self._ended()

    def _ended(self) -> None:
        """From now on a step says that the episode is over."""
        self._transition = self._late

    def _late(self, action: float) -> Transition:
        gym.logger.warn("step() after the end of an episode: call reset() first; what it returns now means nothing")
        return self._going(action)

    @property
    def true_rig(self) -> dict[str, float]:
        """Parameters of the simulated rig in this episode by name, in SI; only an oracle may know them."""
        return self.simulation.lane_rig(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, float]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the environment's own generator. Without one the generator goes on drawing.
        options : dict, optional
            What this episode has otherwise than the environment: "rig" (parameters to change), "reference",
            "disturbance", "posture" (mappings), "initial_position" (of the output, SI).

        Returns
        -------
        observation : ndarray, shape (channels,), float32
            SI values of the channels over their scales.
        info : dict of str to float
            SI numbers of this instant, with the same keys at every step.

        Raises
        ------
        ConfigurationError
            For options that do not exist or do not fit the environment.
        """
        super().reset(seed=seed)
        self.simulation.reset(self._lane, [self.np_random], options)
        self._take_kernel()
        if self._renderer is not None:
            self._renderer.reset()
        info = self._info()
        if self.render_mode is not None:
            self._draw(info)
        return self._obs.copy(), info

    def _info(self) -> dict[str, float]:
        """The info of this instant, as NumPy's numbers: libraries ask those of a reset for their types."""
        return dict(zip(self.simulation.info_names, self._table.copy(), strict=True))

    def step(self, action: np.ndarray) -> Transition:
        """Go on by one control period.

        Parameters
        ----------
        action : ndarray, shape (1,)
            Command over its range, in [-1, 1]; what is beyond is clipped. Of shape (2,) in an action mode with a second
            command.

        Returns
        -------
        observation : ndarray, shape (channels,), float32
            SI values of the channels over their scales.
        reward : float
            Reward of this step, at most 1.
        terminated : bool
            The cable tore, or the state is no longer finite.
        truncated : bool
            The episode's time is over.
        info : dict of str to float
            SI numbers of this instant.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first `reset`.
        ValueError
            For an action of another shape or that is no finite number.
        """
        try:
            (value,) = action.tolist()
            fine = -1e30 < value < self._plain_below
        except (AttributeError, TypeError, ValueError):
            fine = False
        if not fine:
            value = self._checked(action)
        if self.render_mode is None:
            return self._transition(value)
        result = self._transition(value)
        self._draw(result[4])
        return result

    def _checked(self, action: Any) -> float:
        """An action that is no array of one number in range: its first number, or the error that it makes.

        A second number goes to its place in the buffers.
        """
        if self._kernel is None:
            _not_reset(0.0)
        given = np.asarray(action)
        if given.shape != self.action_space.shape:
            raise ValueError(f"action must have shape {wanted_shape(self.setup)}, got {given.shape}")
        values = given.tolist()
        for value in values:
            if not -1e30 < value < 1e30:
                what = "a finite number" if len(values) == 1 else "two finite numbers"
                raise ValueError(f"action must be {what} in [-1, 1], got {value}")
        if len(values) > 1:
            self._second[0] = values[1]
        return values[0]

    def _draw(self, info: Mapping[str, float]) -> None:
        if self._renderer is None:
            from cable_envs.render import Renderer

            self._renderer = Renderer.for_setup(self.setup, str(self.render_mode), self.render_theme)
        self._renderer.push(info, info["time"], info["reference"], info["output"])
        if self.render_mode != "rgb_array":
            self._renderer.show()

    def render(self) -> np.ndarray | None:
        """Draw the present state.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3), or None
            The scene in RGB where ``render_mode`` is "rgb_array". None for "human" and "web", whose window or page
            `step` and `reset` keep up to date; the page's address is printed. None without a mode,
            with a warning of Gymnasium.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first `reset`.
        """
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

"""The state of one or many environments of the same `Setup`: reset, step, delays. Knows no Gymnasium."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_envs.errors import ConfigurationError, require_known
from cable_envs.plants.base import COMMAND, INPUTS, MODE
from cable_envs.references import FIELDS, KEY, evaluate, pack_signal
from cable_envs.setup import Setup
from cable_envs.steppers import STEPPERS, Buffers, measure_all
from cable_envs.tasks import INFO

RESET_OPTIONS = ("rig", "reference", "disturbance", "initial_position")


def proxy_gain(setup: Setup) -> float:
    """Value of the proxy signal for one unit of output if the cable were rigid and without friction."""
    values = setup.rig.values
    if setup.plant.name == "cable_hole":
        return 1.0
    ratio = values["output_radius"] / values["drive_radius"]
    return ratio if setup.task.kind == "position" else 1.0 / ratio


class Simulation:
    """``n`` environments side by side. Single environments are a simulation of one: there is no other code path."""

    def __init__(self, setup: Setup, n: int):
        self.setup, self.n = setup, n
        plant, task = setup.plant, setup.task
        self.info_names = (*INFO, *(s.name for s in plant.signals))
        self._nominal = np.array([setup.rig.values[name] for name in plant.parameters.names])
        self.values = np.repeat(self._nominal[:, None], n, axis=1)
        p = plant.prepare(self.values)
        channels = setup.channels
        self.buffers = Buffers(
            x=plant.rest(p, np.zeros(n)),
            p=p,
            u=np.zeros((len(INPUTS), n)),
            reference=np.zeros((len(FIELDS), n)),
            disturbance=np.zeros((len(FIELDS), n)),
            limits=np.zeros((3, n)),
            actions=np.zeros((2, n)),
            steps=np.zeros(n, dtype=np.int64),
            keys=np.zeros(n, dtype=np.int64),
            obs=np.zeros((n, len(channels)), dtype=np.float32),
            reward=np.zeros(n),
            terminated=np.zeros(n, dtype=np.bool_),
            truncated=np.zeros(n, dtype=np.bool_),
            info=np.zeros((len(INFO), n)),
            channel_rows=np.array([c.row for c in channels], dtype=np.int64),
            channel_scales=np.array([c.scale for c in channels]),
            noise=setup.noise,
            output_row=plant.row(task.output),
            peak_row=plant.row("peak_tension"),
            proxy_row=plant.row(task.output if task.output in {c.name for c in channels} else task.proxy),
            mode=float(setup.mode_index),
            low=setup.low,
            high=setup.high,
            period=setup.control_period,
            substeps=setup.substeps,
            dt=setup.control_period / setup.substeps,
            error_scale=float(task.error_scale),
            effort_weight=float(task.effort_weight),
            last_step=setup.steps,
        )
        self._observed_output = plant.row(task.output) == self.buffers.proxy_row
        self._gain = 1.0 if self._observed_output else proxy_gain(setup)
        self._step, self._step_threads = STEPPERS[plant.name]
        self._late_actions = np.zeros((setup.action_delay, n))
        self._late_obs = np.zeros((setup.sensor_delay, n, len(channels)), dtype=np.float32)
        self._clock = 0

    def reset(
        self, lanes: np.ndarray, generators: Sequence[np.random.Generator], options: Mapping[str, Any] | None = None
    ) -> None:
        """Start new episodes in ``lanes``; ``generators[k]`` draws for ``lanes[k]``.

        options: "rig" (mapping of parameters for this episode), "reference", "disturbance" (mappings),
        "initial_position" (output position at the start, SI). Raises ConfigurationError for anything else.
        """
        options = dict(options or {})
        require_known("reset option", options, RESET_OPTIONS)
        s, setup = self.buffers, self.setup
        rig = setup.rig.replace(options["rig"]) if options.get("rig") else setup.rig
        values = np.repeat(np.array([rig.values[n] for n in setup.plant.parameters.names])[:, None], len(lanes), axis=1)
        reference = pack_signal("reference", options.get("reference") or setup.reference)
        push = pack_signal("disturbance", options.get("disturbance") or setup.disturbance)
        rows = [setup.plant.parameters.index(name) for name, _, _ in setup.randomize]
        for k, (lane, rng) in enumerate(zip(lanes, generators, strict=True)):
            key = int(rng.integers(1, 2**52))
            draws = rng.random(len(rows))
            for row, draw, (_, low, high) in zip(rows, draws, setup.randomize, strict=True):
                values[row, k] = low + draw * (high - low)
            s.keys[lane] = key
            s.reference[:, lane], s.disturbance[:, lane] = reference, push
            s.reference[KEY, lane], s.disturbance[KEY, lane] = key, key + 1
        self.values[:, lanes] = values
        p = setup.plant.prepare(values)
        s.p[:, lanes] = p
        s.x[:, lanes] = setup.plant.rest(p, self._start(lanes, values, options.get("initial_position")))
        self._rest_command(lanes)
        index = setup.plant.parameters.index
        s.limits[0, lanes] = values[index("tension_limit")]
        s.limits[1, lanes] = values[index("breaking_tension")]
        s.limits[2, lanes] = self._gain
        s.steps[lanes] = 0
        s.reward[lanes] = 0.0
        s.terminated[lanes] = s.truncated[lanes] = False
        measure_all(s, lanes)
        if self._late_obs.size:
            self._late_obs[:, lanes] = s.obs[lanes]
        if self._late_actions.size:
            self._late_actions[:, lanes] = s.actions[0, lanes]

    def _start(self, lanes: np.ndarray, values: np.ndarray, position: float | None) -> np.ndarray:
        """Output position at rest: as asked for, else where the output equals the reference at t = 0."""
        if position is not None:
            if not np.isfinite(position):
                raise ConfigurationError(f"initial_position: expected a finite number, got {position!r}")
            return np.full(len(lanes), float(position))
        r = np.array([evaluate(self.buffers.reference, lane, 0.0)[0] for lane in lanes])
        index = self.setup.plant.parameters.index
        if self.setup.task.kind == "tension":
            return r / values[index("load_stiffness")]
        if self.setup.task.kind == "torque":
            return values[index("contact_angle")] + r / values[index("contact_stiffness")]
        return r

    def _rest_command(self, lanes: np.ndarray) -> None:
        s, mode = self.buffers, self.setup.action_mode
        held = s.x[self.setup.plant.row(mode.rest_signal)][lanes] if mode.rest_signal else 0.0
        s.u[:, lanes] = 0.0
        s.u[COMMAND, lanes] = held
        s.u[MODE, lanes] = s.mode
        s.actions[:, lanes] = np.clip(2.0 * (held - s.low) / (s.high - s.low) - 1.0, -1.0, 1.0)

    def step(self, actions: np.ndarray, threads: bool = False) -> None:
        """Advance all environments by one control period; actions [n] in [-1, 1]. Results are in ``buffers``."""
        if self._late_actions.size:
            slot = self._clock % len(self._late_actions)
            actions, self._late_actions[slot] = self._late_actions[slot].copy(), actions
        (self._step_threads if threads else self._step)(self.buffers, actions, 0, self.n)
        if self._late_obs.size:
            slot = self._clock % len(self._late_obs)
            late = self._late_obs[slot].copy()
            self._late_obs[slot] = self.buffers.obs
            self.buffers.obs[:] = late
        self._clock += 1

    def lane_rig(self, lane: int = 0) -> dict[str, float]:
        """The true rig parameters of one environment in its present episode, SI."""
        return self.setup.plant.parameters.unpack(self.values[:, lane])

"""The state of one or many environments of the same `Setup`: reset, step, delays. Knows no Gymnasium."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.kernels import LANES, handed, ready
from cable_envs.core.params import is_number
from cable_envs.core.team import Team
from cable_envs.plants import family
from cable_envs.sim import steppers
from cable_envs.sim.buffers import Buffers
from cable_envs.sim.references import FIELDS, evaluate
from cable_envs.sim.setup import Setup, require_posture
from cable_envs.sim.stepsize import check_step
from cable_envs.sim.suite.drawing import DrawnSignal
from cable_envs.sim.suite.judging import JUDGED
from cable_envs.sim.tasks import INFO, action_of

FARTHEST = 1000.0
"""Largest initial position, m or rad: beyond, no cable is long enough."""

RESET_OPTIONS = ("rig", "reference", "disturbance", "posture", "initial_position")


def proxy_gain(setup: Setup) -> float:
    """Change of the proxy signal for one unit of output if the cable were rigid and without friction.

    Parameters
    ----------
    setup : Setup
        Names the task and the nominal rig.

    Returns
    -------
    float
        In the unit of the proxy over that of the output.
    """
    return family(setup.rig.plant).output(setup.task.kind).rigid(setup.rig.values)


def generator_of(state: Mapping[str, Any] | None) -> np.random.Generator | None:
    """A random generator of Gymnasium's kind in a state.

    Parameters
    ----------
    state : mapping or None
        ``generator.bit_generator.state``.

    Returns
    -------
    numpy.random.Generator or None
        None for None.
    """
    if state is None:
        return None
    generator = np.random.Generator(np.random.PCG64(0))
    generator.bit_generator.state = state
    return generator


class Simulation:
    """The state of n environments side by side.

    A single environment is a simulation of one: there is no other code path.

    Parameters
    ----------
    setup : Setup
        What defines the environments.
    n : int
        Number of environments.

    Attributes
    ----------
    info_names : tuple of str
        Names of the values of an info.
    values : ndarray, shape (len(plant.table), n)
        True parameters of the rig in the present episodes, SI.
    buffers : Buffers
        What the kernels read and write.
    asked : ndarray, shape (n,)
        Actions to take, in [-1, 1]; written by the caller.
    spread : float
        Share of the randomisation ranges, about the nominal rig, that the next episodes are drawn from.
    with_effects : int
        Number of the kernel that is in use, as of `Plant.kernel_needed`. All that can simulate an environment give the
        same numbers.
    kernel : callable
        The kernel of a control step.
    """

    def __init__(self, setup: Setup, n: int):
        self.setup, self.n = setup, n
        plant = setup.plant
        judged = JUDGED.names if setup.conditions is not None else ()
        self.info_names = (*INFO.names, *judged, *(s.name for s in plant.signals))
        self._column = setup.rig.column(plant)
        self.values = np.repeat(self._column, n, axis=1)
        self.buffers = Buffers.of(setup, n)
        self._named = self.buffers.named
        self._nominal = self._prepared(self._column)
        self._delays = [k for k, name in enumerate(plant.table.names) if name.startswith("sensor_delay.")]
        self._gain = 1.0 if setup.output_observed else proxy_gain(setup)
        usual = {"reference": setup.reference, "disturbance": setup.disturbance, "posture": setup.posture}
        self._usual = {what: DrawnSignal.of(what, spec) for what, spec in usual.items()}
        self._choose(max(int(setup.sensor_steps > 0), self._needed(self._nominal)))
        self.asked = self._named.asked
        self.spread = 1.0

    def draw(self, generators: Sequence[np.random.Generator]) -> np.ndarray:
        """All that the next episodes take from their generators.

        Parameters
        ----------
        generators : sequence of numpy.random.Generator
            One for each episode; they go on.

        Returns
        -------
        ndarray, shape (m, 1 + numbers that are randomised)
            The key of each episode, a whole number, from which all else is drawn; then numbers in [0, 1).
        """
        count = len(self.setup.randomize)
        drawn = np.empty((len(generators), 1 + count))
        for k, rng in enumerate(generators):
            drawn[k, 0] = rng.integers(1, 2**52)
            if count:
                drawn[k, 1:] = rng.random(count)
        return drawn

    def reset(
        self, lanes: np.ndarray, source: Sequence[np.random.Generator] | np.ndarray,
        options: Mapping[str, Any] | None = None,
    ) -> None:  # fmt: skip
        """Begin new episodes.

        Parameters
        ----------
        lanes : ndarray of int, shape (m,)
            Environments that begin one.
        source : sequence of numpy.random.Generator, or ndarray
            ``source[k]`` draws for environment ``lanes[k]``; or what `draw` has taken from the generators before.
        options : mapping, optional
            "rig" (parameters to change), "reference", "disturbance", "posture" (mappings), "initial_position" (of the
            output, SI), for these episodes.

        Raises
        ------
        ConfigurationError
            For other options, values that do not fit, and a sensor's delay longer than the environment was made for.
        """
        options = dict(options or {})
        require_known("reset option", options, RESET_OPTIONS)
        signals, conditions = self._signals(options), self.setup.conditions
        values, p = self._rigs(len(lanes), options.get("rig"))
        parameters = self.setup.plant.table
        rows = [parameters.index(name) for name, _, _ in self.setup.randomize]
        keys, *shares = (source if isinstance(source, np.ndarray) else self.draw(source)).T
        if conditions is not None and conditions.cable_rows:
            for k, key in enumerate(keys):
                conditions.draw_cable(values[:, k], key)
        for row, share, (_, low, high) in zip(rows, shares, self.setup.randomize, strict=True):
            if self.spread != 1.0:
                low, high = (values[row] + self.spread * (end - values[row]) for end in (low, high))
            values[row] = low + share * (high - low)
        reference, disturbance, posture = (one.draw(keys, number) for number, one in enumerate(signals))
        key = FIELDS.row("key")
        reference[key], disturbance[key], posture[key] = keys, keys + 1.0, keys + 2.0
        drawn = bool(rows) or (conditions is not None and bool(conditions.cable_rows))
        if drawn:
            p = self._prepared(values)
            check_step(self.setup.plant, p, self.setup.control_period, self.setup.substeps, "a rig of this reset")
        start = self._start(reference, values, options.get("initial_position"))
        zero = np.zeros(len(lanes))
        if conditions is not None:
            away, zero = conditions.places(keys)
            start = start + (away if options.get("initial_position") is None else 0.0)
        x = self.setup.plant.rest(p, start)
        if self.setup.plant.posture:
            bent = x[self.setup.plant.row(self.setup.plant.posture)]
            bent[:] = np.maximum(bent + evaluate(posture, 0.0)[0], 0.0)

        if drawn or options.get("rig") is not None:  # else it is the nominal rig, which was looked at before
            if self._needed(p) > self.with_effects:
                self._choose(self._needed(p))
            self._check_delays(values)
        b, s = self.buffers, self._named
        self.values[:, lanes], b.p[:, lanes], b.x[:, lanes] = values, p, x
        s.followed[:, lanes], s.push[:, lanes], s.bending[:, lanes] = reference, disturbance, posture
        s.key[lanes], s.zero[lanes] = keys, zero
        self._tearing(lanes, values)
        s.proxy_gain[lanes] = self._gain
        s.step[lanes] = s.reward[lanes] = s.terminated[lanes] = s.truncated[lanes] = 0.0
        self._hold_still(lanes, x)
        begin = steppers.begin_of(1 if self.with_effects else None, conditions is not None)
        begin(b.block, b.obs, b.common, lanes)

    def _tearing(self, lanes: np.ndarray, values: np.ndarray) -> None:
        """The tensions beyond which mechanisms are overloaded and tear; none of a plant that cannot."""
        parameters, s = self.setup.plant.table, self._named
        for name in ("tension_limit", "breaking_tension"):
            getattr(s, name)[lanes] = values[parameters.index(name)] if self.setup.plant.tears else np.inf

    def _prepared(self, values: np.ndarray) -> np.ndarray:
        """Coefficients; where the step need not fit the rig, the rig is made to fit the step."""
        plant = self.setup.plant
        p = plant.prepare(values)
        if plant.resolves is None:
            plant.raise_to(p, self.setup.control_period / self.setup.substeps)
        return p

    def _needed(self, p: np.ndarray) -> int:
        return max(self.setup.plant.kernel_needed(p), int(self.setup.plant.effects.distorted(p)))

    def _choose(self, with_effects: int) -> None:
        """Step with the kernel of this number: it gives the numbers of a quicker one where that would do."""
        self.with_effects = with_effects
        self.kernel = steppers.kernels_of(self.setup.plant, self.setup.conditions is not None)[with_effects]

    def advance(self) -> Callable[[], None]:
        """The step of all environments by one control period.

        Returns
        -------
        callable
            Called without arguments, it takes the actions in ``asked`` and leaves its results in ``buffers``.

        Notes
        -----
        The call belongs to the present `kernel`. A reset that brings in the first effect changes the kernel; `advance`
        is then to be asked again.
        """
        b = self.buffers
        return partial(ready(self.kernel, b.block, b.obs, b.common, 0, self.n), b.block, b.obs, b.common, 0, self.n)

    def single_kernel(self) -> Callable[..., tuple]:
        """The compiled step of a single environment.

        Returns
        -------
        callable
            (block, obs, common, action) -> (reward, terminated, truncated, *values of the info), on the arrays of
            `buffers` as `cable_envs.core.kernels.handed` gives them.
        """
        b = self.buffers
        kernel = steppers.single_kernels_of(self.setup.plant, self.setup.conditions is not None)[self.with_effects]
        return ready(kernel, handed(b.block), handed(b.obs), handed(b.common), 0.0)

    def _check_delays(self, values: np.ndarray) -> None:
        delays = values[self._delays].max(axis=1)
        longest = float(delays.max())
        if longest > self.setup.sensor_steps * self.setup.control_period + 1e-9:
            name = self.setup.plant.table.names[self._delays[int(delays.argmax())]]
            raise ConfigurationError(
                f"{name} = {longest:g} s is longer than the environment was made for; give it the longest delay "
                f"when it is made: effects={{'sensor_delay': {{'{name.split('.')[1]}': {longest:g}}}}}"
            )

    def _signals(self, options: Mapping[str, Any]) -> list[DrawnSignal]:
        """Reference, disturbance and posture of the next episodes."""
        found = []
        for what, usual in self._usual.items():
            given = options.get(what)
            if what == "posture" and given is not None:
                require_posture(self.setup.plant)
            found.append(usual if given is None else DrawnSignal.of(what, given))
        return found

    def _rigs(self, n: int, changes: Any) -> tuple[np.ndarray, np.ndarray]:
        """(parameter columns, coefficient columns) of the nominal rig, or of one with some parameters changed."""
        if changes is None:
            column, p = self._column, self._nominal
        elif isinstance(changes, Mapping):
            column = self.setup.rig.replace(changes).column(self.setup.plant)
            p = self._prepared(column)
            check_step(self.setup.plant, p, self.setup.control_period, self.setup.substeps, "the rig of this reset")
        else:
            raise ConfigurationError(f"reset option 'rig': expected a mapping of parameters to change, got {changes!r}")
        return np.repeat(column, n, axis=1), np.repeat(p, n, axis=1)

    def _start(self, reference: np.ndarray, values: np.ndarray, position: Any) -> np.ndarray:
        """Output position at rest [n]: as asked for, else where the output equals the reference at t = 0."""
        n = values.shape[1]
        if position is not None:
            if not is_number(position):
                raise ConfigurationError(f"reset option 'initial_position': expected a finite number, got {position!r}")
            if abs(position) > FARTHEST:
                raise ConfigurationError(
                    f"reset option 'initial_position': expected at most {FARTHEST:g} m or rad, got {position!r}"
                )
            return np.full(n, float(position))
        r = evaluate(reference, 0.0)[0]
        named = dict(zip(self.setup.plant.parameters.names, values, strict=False))
        return family(self.setup.rig.plant).output(self.setup.task.kind).start(named, r)

    def _hold_still(self, lanes: np.ndarray, x: np.ndarray) -> None:
        """The command, and the action, that keep mechanisms at rest with signals ``x``."""
        s, u, mode = self._named, self.buffers.u, self.setup.action_mode
        held = x[self.setup.plant.row(mode.rest_signal)] if mode.rest_signal else np.zeros(len(lanes))
        u.rows[:, lanes] = 0.0
        u.command[lanes], u.mode[lanes] = held, self.setup.plant.number_of(mode)
        told = held + self.buffers.common[0].shifted * s.zero[lanes]
        s.action[lanes] = s.last_action[lanes] = np.clip(action_of(told, *self.setup.ranges[0]), -1.0, 1.0)
        second = mode.second
        if second is not None:
            row = self.setup.plant.row
            held = x[row(second.rest_signal)] if second.rest_signal else np.zeros(len(lanes))
            u.second[lanes] = self.buffers.x[row(f"{second.name}_command"), lanes] = held
            s.second_action[lanes] = s.last_second[lanes] = np.clip(action_of(held, *self.setup.ranges[-1]), -1.0, 1.0)

    def state(self, lanes: np.ndarray | None = None) -> dict[str, Any]:
        """Everything that changes from step to step, as copies.

        Parameters
        ----------
        lanes : ndarray of int, shape (m,), optional
            Environments whose state it is; by default all.

        Returns
        -------
        dict
            What `restore` takes: of the single environment as of those of a batch.
        """
        chosen = np.arange(self.n) if lanes is None else lanes
        s = self.buffers
        return {
            "block": s.block[:, chosen], "obs": s.obs[chosen], "values": self.values[:, chosen],
            "spread": self.spread, "with_effects": self.with_effects, "common": s.common.tobytes(),
        }  # fmt: skip

    def restore(self, state: Mapping[str, Any], lanes: np.ndarray | None = None) -> None:
        """Go back to a `state`.

        Parameters
        ----------
        state : mapping
            A `state` of a simulation with the same setup, of one environment or of as many as are restored. That of one
            goes into each of them.
        lanes : ndarray of int, shape (m,), optional
            Environments that go back; by default all.

        Raises
        ------
        ConfigurationError
            Where it is of other settings, of another number of environments, or of a version with other parameters.
        """
        chosen = np.arange(self.n) if lanes is None else lanes
        s = self.buffers
        saved = np.shape(state["block"])[-1]
        if saved not in (1, len(chosen)):
            raise ConfigurationError(
                f"the saved state does not fit: it is of {saved} environments, and {len(chosen)} are to be restored; "
                "the state of one goes into any number"
            )
        fits = (
            state.get("common") == s.common.tobytes()
            and np.shape(state["block"])[0] == len(s.block)
            and np.shape(state["values"])[0] == len(self.values)
        )
        if not fits:
            raise ConfigurationError(
                "the saved state does not fit this simulation: it was saved with other settings or by another version; "
                "begin again, or go on with what saved it"
            )
        s.block[:, chosen], s.obs[chosen], self.values[:, chosen] = state["block"], state["obs"], state["values"]
        if lanes is None:
            self.spread = state["spread"]
        self._choose(max(int(state["with_effects"]), self.with_effects if lanes is not None else 0))

    def team(self, size: int) -> Team:
        """The call of `advance`, shared by ``size`` threads; the caller's own is one of them."""
        s = self.buffers
        kernel = ready(self.kernel, s.block, s.obs, s.common, 0, self.n)
        return Team(kernel, (s.block, s.obs, s.common), self.n, size, LANES)

    def lane_rig(self, lane: int = 0) -> dict[str, float]:
        """True parameters of the rig of one environment in its present episode.

        Parameters
        ----------
        lane : int
            Number of the environment.

        Returns
        -------
        dict of str to float
            The plant's own parameters by name, SI, without those of effects.
        """
        parameters = self.setup.plant.parameters
        return parameters.unpack(self.values[: len(parameters), lane])

    def lane_effects(self, lane: int = 0) -> dict[str, float]:
        """True parameters of effects of one environment in its present episode.

        Parameters
        ----------
        lane : int
            Number of the environment.

        Returns
        -------
        dict of str to float
            Those that are not at null, SI, under dotted names.
        """
        table, own = self.setup.plant.table, len(self.setup.plant.parameters)
        values = table.unpack(self.values[:, lane])
        return {name: values[name] for name in table.names[own:] if values[name] != table[name].default}

"""Many episodes side by side in the simulator: what commands lead to, and how that depends on them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.sim.buffers import ENVIRONMENT, INFO
from cable_envs.sim.simulation import Simulation
from cable_envs.sim.suite.judging import JUDGED

LANES = 20000
"""Environments that are stepped at once where slopes are taken: about 20 MB."""

STEP, LEAST = 1e-4, 1e-9
"""Differences for slopes: share of a state's range in the episodes, and its least, SI."""


@dataclass(frozen=True)
class Motion:
    """What a trajectory of each episode does to its score, step by step.

    Attributes
    ----------
    a, b : ndarray, shape (steps, episodes, states, states) and (steps, episodes, states)
        Slopes of the states after a step by those before it and by the action.
    output : int
        Place of the output in the state.
    error : ndarray, shape (steps, episodes)
        With the sign of the error and, on tasks of suite v1, up to twice its size for the price that goes with it; SI.
    weight : ndarray, shape (steps,)
        1 for steps that are scored, 0 during the homing.
    filter : int
        Place of the state of the command's high pass; -1 where nothing is priced.
    price, passed : ndarray, shape (steps, episodes)
        What a squared passed command costs later steps, in squared SI units of the error, and the passed command.
    direct : float
        Change of the passed command with the action.
    """

    a: np.ndarray
    b: np.ndarray
    output: int
    error: np.ndarray
    weight: np.ndarray
    filter: int
    price: np.ndarray
    passed: np.ndarray
    direct: float


class Plants:
    """Episodes of one setup, each with its own rig and reference, from where they begin.

    Parameters
    ----------
    states : sequence of mapping
        `Simulation.state` of each episode, right after its reset.
    setup : Setup
        Of all of them.
    """

    def __init__(self, states: Sequence[Any], setup: Any):
        self.setup, self.episodes = setup, len(states)
        self._states = list(states)
        self._sizes = sizes = Simulation(setup, 1).buffers.common[0]
        first = ENVIRONMENT.count + int(sizes.judged)
        waiting = range(int(sizes.waiting), int(sizes.waiting + sizes.action_delay))
        # the price of a command that comes late is left to the trials
        self._filter = [ENVIRONMENT.row(n) for n in ("passed_1", "passed_2")] if sizes.judged and not waiting else []
        self._rows = np.array([
            ENVIRONMENT.row("inputs", 0), *self._filter, *range(first, first + int(sizes.signals + sizes.states)),
            *waiting,
        ])  # fmt: skip
        self._output = first + int(sizes.output)
        self._error = ENVIRONMENT.row("info", INFO.row("error"))
        self._scored = ENVIRONMENT.count + JUDGED.row("priced_error") if sizes.judged else self._error
        ends = setup.control_period * np.arange(1, setup.steps + 1)
        self.weight = (ends >= setup.task.homing - 1e-9).astype(float)
        self._made: dict[int, Simulation] = {}

    def simulation(self, copies: int) -> Simulation:
        """A simulation of every episode ``copies`` times over, at its beginning."""
        n = self.episodes * copies
        if n not in self._made:
            self._made[n] = Simulation(self.setup, n)
        made = self._made[n]
        for k, state in enumerate(self._states):
            made.restore(state, np.arange(k * copies, (k + 1) * copies))
        return made

    def follow(self, act: Callable[[int, np.ndarray], np.ndarray], copies: int, keep: bool = False) -> Any:
        """Step through all episodes.

        Parameters
        ----------
        act : callable
            (step, states [episodes * copies, states]) -> actions [episodes * copies].
        copies : int
            How often each episode runs; those of one lie side by side.
        keep : bool
            Whether to return the whole block before every step.

        Returns
        -------
        cost : ndarray, shape (episodes, copies)
            Mean square of the error that is scored, after the homing; infinite where an episode ended early.
        errors : ndarray, shape (steps, episodes * copies)
            Reference less output at the end of each step, SI.
        blocks : ndarray or None
            Shape (steps + 1, rows, episodes * copies).
        """
        made = self.simulation(copies)
        step, block, n = made.advance(), made.buffers.block, self.episodes * copies
        steps, rows = self.setup.steps, self.rows
        errors, ended, square = np.empty((steps, n)), np.zeros(n, bool), np.zeros(n)
        blocks = np.empty((steps + 1, len(block), n)) if keep else None
        for k in range(steps):
            if blocks is not None:
                blocks[k] = block[:, :n]
            made.asked[:] = act(k, block[rows, :n].T)
            step()
            errors[k] = block[self._error, :n]
            square += self.weight[k] * block[self._scored, :n] ** 2
            ended |= made.buffers.named.terminated > 0.5
        if blocks is not None:
            blocks[steps] = block[:, :n]
        cost = np.where(ended | ~np.isfinite(square), np.inf, square / self.weight.sum())
        return cost.reshape(self.episodes, copies), errors, blocks

    @property
    def rows(self) -> np.ndarray:
        """Rows of the block that are the state: last command, the plant's signals and memory, waiting actions."""
        return self._rows

    def errors(self, blocks: np.ndarray) -> np.ndarray:
        """Reference less output at the end of each step, [steps, episodes], SI."""
        return blocks[1:, self._error]

    def relevant(self, blocks: np.ndarray) -> None:
        """Leave out of the state what does not reach the output, seen from some steps."""
        a, _, _ = self.slopes(blocks[:: max(1, len(blocks) // 40)], self.scales(blocks))
        acts_on = np.any(a != 0.0, axis=(0, 1))  # [after, before]
        used = np.isin(self.rows, [self._output, *self._filter])
        for _ in used:
            used = used | np.any(acts_on[used], axis=0)
        self._rows = self.rows[used]

    def motion(self, blocks: np.ndarray, actions: np.ndarray, share: float = STEP, tame: bool = False) -> Motion:
        """Slopes and prices along trajectories.

        Parameters
        ----------
        blocks : ndarray, shape (steps + 1, rows, episodes)
            As of `follow`.
        actions : ndarray, shape (steps, episodes)
            That led to them.
        share : float
            Difference for the slopes, as a share of each state's range.
        tame : bool
            As of `slopes`.

        Returns
        -------
        Motion
        """
        a, b, output = self.slopes(blocks, self.scales(blocks, share), tame)
        error = self.errors(blocks)
        if not self._filter:
            empty = np.zeros_like(error)
            return Motion(a, b, output, error, self.weight, -1, empty, empty, 0.0)
        c = self._sizes
        priced = blocks[1:, self._scored]
        dear = self.weight[:, None] * priced * c.error_scale / c.activity_limit**2
        price, later = np.empty_like(error), np.zeros(self.episodes)
        for k in range(len(price) - 1, -1, -1):
            later = dear[k] + (1.0 - c.fading) * later
            price[k] = c.fading * later
        price[blocks[1:, ENVIRONMENT.row("paused")] > 0.0] = 0.0
        direct = 0.5 * float(c.pass_b)
        passed = direct * actions + blocks[:-1, self._filter[0]]
        shown = np.sign(error) * np.minimum(priced, 2.0 * np.abs(error))
        place = int(np.flatnonzero(self.rows == self._filter[0])[0])
        return Motion(a, b, output, shown, self.weight, place, price, passed, direct)

    def scales(self, blocks: np.ndarray, share: float = STEP) -> np.ndarray:
        """Difference by which each state is changed for slopes, SI."""
        return np.maximum(share * np.ptp(blocks[:, self.rows], axis=(0, 2)), LEAST)

    def slopes(self, blocks: np.ndarray, change: np.ndarray, tame: bool = False) -> tuple[np.ndarray, np.ndarray, int]:
        """How the states after each step depend on those before it and on the action, by central differences.

        Parameters
        ----------
        blocks : ndarray, shape (steps + 1, rows, episodes)
            As of `follow`.
        change : ndarray, shape (states,)
            Differences, SI.
        tame : bool
            Whether to take the smaller one of the slopes to both sides, and 0 where they differ in sign: at the kinks
            of play and dry friction a jump over a small difference is no slope.

        Returns
        -------
        a : ndarray, shape (steps, episodes, states, states)
            Slopes by the states.
        b : ndarray, shape (steps, episodes, states)
            Slopes by the action.
        output : int
            Place of the output in the state.
        """
        steps, episodes, n = len(blocks) - 1, self.episodes, len(self.rows)
        output = int(np.flatnonzero(self.rows == self._output)[0])
        both = np.concatenate([change, [STEP]])
        per = max(1, LANES // (episodes * 2 * (n + 1)))
        made = Simulation(self.setup, per * episodes * 2 * (n + 1))
        made._choose(max(int(s["with_effects"]) for s in self._states))
        step, block = made.advance(), made.buffers.block
        asked = ENVIRONMENT.row("asked")
        a, b = np.empty((steps, episodes, n, n)), np.empty((steps, episodes, n))
        moved = np.append(self.rows, asked)
        for first in range(0, steps, per):
            part = blocks[first : first + per]
            took = blocks[first + 1 : first + 1 + per, asked]
            part = part[: len(took)].copy()
            part[:, asked] = took
            here = np.repeat(part.transpose(1, 0, 2)[:, :, :, None, None], n + 1, axis=3)
            here = np.concatenate([here, here], axis=4)  # rows, steps, episodes, which, way
            for j, row in enumerate(moved):
                here[row, :, :, j, 0] += both[j]
                here[row, :, :, j, 1] -= both[j]
            lanes = here[0].size
            block[:, :lanes] = here.reshape(len(here), lanes)
            block[:, lanes : made.n] = block[:, :1]
            step()
            after = block[self.rows, :lanes].reshape(n, *here.shape[1:])
            slope = (after[..., 0] - after[..., 1]) / (2.0 * both)
            if tame:
                here = blocks[first + 1 : first + 1 + len(took)][:, self.rows].transpose(1, 0, 2)[..., None]
                up, down = (after[..., 0] - here) / both, (here - after[..., 1]) / both
                slope = np.where(up * down > 0.0, np.where(np.abs(up) < np.abs(down), up, down), 0.0)
            a[first : first + len(took)] = slope[..., :n].transpose(1, 2, 0, 3)
            b[first : first + len(took)] = slope[..., n].transpose(1, 2, 0)
        return a, b, output

    def overload(self, actions: np.ndarray) -> np.ndarray:
        """Share of the steps with a tension beyond the rig's limit, [episodes], under ``actions`` [steps, episodes]."""
        row = ENVIRONMENT.row("info", INFO.row("overload"))
        _, _, blocks = self.follow(lambda k, _: actions[k], 1, keep=True)
        return (blocks[1:, row] > 0.0).mean(axis=0)

"""Many episodes side by side in the simulator: what commands lead to, and how that depends on them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cable_envs.sim.buffers import ENVIRONMENT, INFO
from cable_envs.sim.simulation import Simulation

LANES = 20000
"""Environments that are stepped at once where slopes are taken: about 20 MB."""

STEP, LEAST = 1e-4, 1e-9
"""Differences for slopes: share of a state's range in the episodes, and its least, SI."""


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
        first = ENVIRONMENT.count
        sizes = Simulation(setup, 1).buffers.common[0]
        waiting = range(int(sizes.waiting), int(sizes.waiting + sizes.action_delay))
        self._rows = np.array(
            [ENVIRONMENT.row("inputs", 0), *range(first, first + int(sizes.signals + sizes.states)), *waiting]
        )
        self._output = first + int(sizes.output)
        self._error = ENVIRONMENT.row("info", INFO.row("error"))
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
            Mean squared error; infinite where an episode ended early.
        errors : ndarray, shape (steps, episodes * copies)
            Reference less output at the end of each step, SI.
        blocks : ndarray or None
            Shape (steps + 1, rows, episodes * copies).
        """
        made = self.simulation(copies)
        step, block, n = made.advance(), made.buffers.block, self.episodes * copies
        steps, rows = self.setup.steps, self.rows
        errors, ended = np.empty((steps, n)), np.zeros(n, bool)
        blocks = np.empty((steps + 1, len(block), n)) if keep else None
        for k in range(steps):
            if blocks is not None:
                blocks[k] = block[:, :n]
            made.asked[:] = act(k, block[rows, :n].T)
            step()
            errors[k] = block[self._error, :n]
            ended |= made.buffers.named.terminated > 0.5
        if blocks is not None:
            blocks[steps] = block[:, :n]
        square = np.where(np.isfinite(errors), errors, np.inf) ** 2
        cost = np.where(ended, np.inf, square.mean(axis=0))
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
        used = self.rows == self._output
        for _ in used:
            used = used | np.any(acts_on[used], axis=0)
        self._rows = self.rows[used]

    def scales(self, blocks: np.ndarray) -> np.ndarray:
        """Difference by which each state is changed for slopes, SI."""
        return np.maximum(STEP * np.ptp(blocks[:, self.rows], axis=(0, 2)), LEAST)

    def slopes(self, blocks: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """How the states after each step depend on those before it and on the action, by central differences.

        Parameters
        ----------
        blocks : ndarray, shape (steps + 1, rows, episodes)
            As of `follow`.
        change : ndarray, shape (states,)
            Differences, SI.

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
            a[first : first + len(took)] = slope[..., :n].transpose(1, 2, 0, 3)
            b[first : first + len(took)] = slope[..., n].transpose(1, 2, 0)
        return a, b, output

    def overload(self, actions: np.ndarray) -> np.ndarray:
        """Share of the steps with a tension beyond the rig's limit, [episodes], under ``actions`` [steps, episodes]."""
        row = ENVIRONMENT.row("info", INFO.row("overload"))
        _, _, blocks = self.follow(lambda k, _: actions[k], 1, keep=True)
        return (blocks[1:, row] > 0.0).mean(axis=0)

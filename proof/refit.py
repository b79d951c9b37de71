"""How much of an effect is left after the nominal parameters are refitted, and the size that leaves a wanted share.

The refit is a step of Gauss and Newton from the truth, and where the parameters absorb half or more a second one from
where it led: an effect that hides almost wholly moves them far. All residuals count in standard deviations of their
channel's noise. On the hole each record's start is refitted, too: what nobody knows exactly is where the load hung.
What a record shows before its motion has left the first place does not count: what friction holds there was left by
what happened before, of which a recording knows nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from cable_envs.proof.rigs import CLOCK, TrueRig, observe, simulated

STEPS = 6
"""Of a refit at most; it ends where what is left is most of what there is."""
AWAY = 0.03
"""Share of its range by which a position has left its first place."""
SHIFT = 1e-5
"""m, by which a start is moved to see what that changes."""


@dataclass(frozen=True)
class Excess:
    """What an effect leaves behind.

    added    | relative growth of a channel's RMS over its noise after the refit, of the channel where it is largest
    absorbed | share of the mismatch's energy that the refit took
    channels | channel -> RMS of what is left over the noise's standard deviation
    left     | [samples, channels] of all records, in standard deviations
    """

    added: float
    absorbed: float
    channels: Mapping[str, float]
    left: np.ndarray


class Refit:
    """The records of one rig without noise, and their sensitivities to what the refit may move."""

    def __init__(self, rig: TrueRig, references: Sequence[np.ndarray], at: Sequence[np.ndarray]):
        self.rig, self._references, self._at = rig, references, at
        self._records = [slice(*ends) for ends in pairwise(accumulate((len(times) for times in at), initial=0))]
        self._std = np.array([rig.noise[c] for c in rig.scored])
        self._plain = self.see({})
        self._counts = self._away()
        columns = []
        for names in rig.free:
            step = {name: 1.01 * rig.values[name] for name in names}
            columns.append((self.see(step) - self._plain).ravel() / 0.01)
        columns += self._starts()
        slopes = np.column_stack(columns) if columns else np.zeros((self._plain.size, 0))
        self._slopes = slopes * np.repeat(self._counts, len(rig.scored))[:, None]
        self._basis = np.linalg.svd(self._slopes, full_matrices=False)[0]

    def see(self, changes: Mapping[str, float]) -> np.ndarray:
        """Scored channels of all records under ``changes``, in standard deviations [samples, channels]."""
        rows = []
        for reference, at in zip(self._references, self._at, strict=True):
            channels = observe(self.rig, changes, reference, at)
            rows.append(np.column_stack([channels[c] for c in self.rig.scored]))
        return np.concatenate(rows) / self._std

    def _away(self) -> np.ndarray:
        """Whether every position of a record has left its first place [samples]."""
        positions = [k for k, name in enumerate(self.rig.scored) if name.endswith(("position", "angle"))]
        found = []
        for rows in self._records:
            seen = self._plain[rows][:, positions]
            far = np.abs(seen - seen[0]) > AWAY * np.ptp(seen, axis=0)
            found.append(np.logical_or.accumulate(far, axis=0).all(axis=1))
        return np.concatenate(found)

    def _starts(self) -> list[np.ndarray]:
        """Change of all channels with the place where the load of each record begins, the commands being the same."""
        if self.rig.system != "cable_hole":
            return []
        told = replace(self.rig, values={**self.rig.values, "kp": 0.0})
        found = []
        for rows, reference, at in zip(self._records, self._references, self._at, strict=True):
            path = self._commanded({}, reference)
            here, there = (observe(told, {}, path + by, at) for by in (0.0, SHIFT))
            column = np.zeros_like(self._plain)
            change = np.column_stack([there[c] - here[c] for c in self.rig.scored])
            column[rows] = change / self._std
            found.append(column.ravel())
        return found

    def _commanded(self, changes: Mapping[str, float], reference: np.ndarray) -> np.ndarray:
        """Where the recorded speed command leads, m, from the reference's start [ticks]."""
        command = self.simulate(changes, reference)["drive_velocity_command"]
        return reference[0] + CLOCK * np.concatenate([[0.0], np.cumsum(0.5 * (command[1:] + command[:-1]))])

    def _under(self, changes: Mapping[str, float], moved: Mapping[str, float]) -> np.ndarray:
        """Scored channels without ``changes``, under the commands that are recorded with them; ``moved``: parameters.

        On the hole a loop turns what is missing into other commands, and those are recorded without noise: whoever
        drives a simulator with them sees only what is left. The other systems' commands are the reference.
        """
        if self.rig.system != "cable_hole" or not self.rig.values["kp"]:
            return self.see(moved) if moved else self._plain
        rows = []
        for reference, at in zip(self._references, self._at, strict=True):
            path = self._commanded(changes, reference)
            channels = observe(replace(self.rig, values={**self.rig.values, **moved, "kp": 0.0}), {}, path, at)
            rows.append(np.column_stack([channels[c] for c in self.rig.scored]))
        return np.concatenate(rows) / self._std

    def simulate(self, changes: Mapping[str, float], reference: np.ndarray) -> dict[str, np.ndarray]:
        """All signals at every tick, before sensors."""
        own = {k: v for k, v in changes.items() if ":" not in k}
        return simulated(self.rig, {**self.rig.values, **own}, reference)

    def excess(self, changes: Mapping[str, float]) -> Excess:
        """What ``changes`` leave after the refit."""
        seen = self.see(changes)
        raw = self._counted(seen - self._under(changes, {}))
        left = raw - self._basis @ (self._basis.T @ raw)
        total, now = np.zeros(len(self.rig.free)), raw
        for _ in range(STEPS):
            if not np.isfinite(now).all() or now @ now <= 2.0 * (left @ left):
                break
            total += np.linalg.lstsq(self._slopes, now, rcond=1e-8)[0][: len(total)]
            total = np.clip(total, -0.5, 0.5)
            moved = {
                n: (1.0 + s) * self.rig.values[n] for names, s in zip(self.rig.free, total, strict=True) for n in names
            }
            now = self._counted(seen - self._under(changes, moved))
            rest = now - self._basis @ (self._basis.T @ now)
            if not rest @ rest < left @ left:
                break
            left = rest
        shaped = left.reshape(-1, len(self._std))
        rms = np.sqrt(np.sum(shaped**2, axis=0) / np.sum(self._counts))
        energy = float(raw @ raw)
        absorbed = 1.0 - float(left @ left) / energy if energy > 0 else 0.0
        added = float(np.sqrt(1.0 + rms.max() ** 2) - 1.0)
        return Excess(added, absorbed, dict(zip(self.rig.scored, rms.tolist(), strict=True)), shaped)

    def _counted(self, rows: np.ndarray) -> np.ndarray:
        """Rows [samples, channels] one after the other, those that do not count as 0."""
        return np.where(self._counts[:, None], rows, 0.0).ravel()

    def gain(self, left: np.ndarray, flat: Callable[[int, np.ndarray], np.ndarray]) -> float:
        """Sum of squares of ``left`` [samples, channels] in its noise, beyond what a refit that knows the noise takes.

        flat(channel, series [T, n]) -> independent numbers [m, n]: the series of one record in that channel's noise.
        """
        slopes, series, columns = self._slopes.reshape(*left.shape, -1), [], []
        for rows in self._records:
            for k in range(left.shape[1]):
                series.append(flat(k, left[rows, k : k + 1])[:, 0])
                columns.append(flat(k, slopes[rows, k]))
        white, moves = np.concatenate(series), np.concatenate(columns)
        moves = moves / np.maximum(np.linalg.norm(moves, axis=0), 1e-300)
        basis, sizes, _ = np.linalg.svd(moves, full_matrices=False)
        taken = basis[:, sizes > 1e-8 * max(float(sizes.max(initial=0.0)), 1e-300)].T @ white
        return float(white @ white - taken @ taken)

    def sized(
        self, change: Callable[[float], Mapping[str, float]], wanted: float, largest: float, tries: int = 6
    ) -> tuple[float, Excess]:
        """(size, what it leaves): the size at which ``change(size)`` adds ``wanted``; ``largest`` where it cannot."""
        goal = np.sqrt((1.0 + wanted) ** 2 - 1.0)
        size, best = min(1.0, largest), None
        for _ in range(tries):
            found = self.excess(change(size))
            rms = np.sqrt((1.0 + found.added) ** 2 - 1.0)
            if np.isfinite(rms) and (best is None or abs(np.log(max(rms, 1e-9) / goal)) < best[0]):
                best = (abs(np.log(max(rms, 1e-9) / goal)), size, found)
            if best is not None and best[0] < 0.06:
                break
            factor = np.clip(goal / rms, 0.02, 20.0) if np.isfinite(rms) and rms > 0 else (20.0 if rms == 0 else 0.1)
            if size >= largest and factor > 1.0:
                break
            size = min(size * float(factor), largest)
        if best is None:
            raise ValueError("no size of the effect gives a finite recording")
        return best[1], best[2]

"""One episode as it was run: arrays and the facts needed to judge and to replay it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Episode:
    """One episode, in SI, one sample for each control step (sample k is taken at the end of step k).

    All arrays have shape [n], n the number of steps taken: below `horizon` where a torn cable cut the episode short.

    | field | meaning |
    |---|---|
    | time | s since reset |
    | reference, output | the controlled quantity, in `output_unit` |
    | command | what the drive was told, in `command_unit` (after clipping to the action range) |
    | reward | per step |
    | signals | further signals by name: tensions, slack_fraction, overload, phase, ... |
    | terminated | the cable tore, or the state stopped being finite |
    | horizon | steps of a full episode |
    | inference | s spent in the policy, per step |
    | settings | what produced it: env_id, rig, controller, seed, options, ... (JSON types only) |
    | step_time | when the reference steps (s); None where it does not step |
    | success_error | largest error of the last fifth that counts as success, in `output_unit`; None: not judged |
    | homing | s from the start in which nothing is scored |
    """

    time: np.ndarray
    reference: np.ndarray
    output: np.ndarray
    command: np.ndarray
    reward: np.ndarray
    inference: np.ndarray
    signals: Mapping[str, np.ndarray]
    terminated: bool
    dt: float
    horizon: int
    output_unit: str = "1"
    command_unit: str = "1"
    step_time: float | None = None
    success_error: float | None = None
    homing: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = {
            "time": self.time,
            "reference": self.reference,
            "output": self.output,
            "command": self.command,
            "reward": self.reward,
            "inference": self.inference,
            **self.signals,
        }
        n = len(self.time)
        for name, values in arrays.items():
            if np.shape(values) != (n,):
                raise ValueError(f"episode array '{name}' has shape {np.shape(values)}, expected ({n},)")
        if n == 0:
            raise ValueError("an episode needs at least one step")

    @property
    def error(self) -> np.ndarray:
        """reference - output [n], in `output_unit`."""
        return self.reference - self.output

    @property
    def complete(self) -> bool:
        """Whether it ran to its time limit without tearing the cable and with finite output."""
        return not self.terminated and len(self.time) >= self.horizon and bool(np.all(np.isfinite(self.output)))

    def thinned(self, points: int) -> dict[str, np.ndarray]:
        """For drawing: fewer samples of every array.

        Parameters
        ----------
        points : int
            Samples to keep at most; they are evenly spaced, the first and the last among them.

        Returns
        -------
        dict of ndarray
            By name, float32 [points], and ``failed``, a bool.
        """
        index = np.unique(np.linspace(0, len(self.time) - 1, min(points, len(self.time))).round().astype(int))
        arrays = {"time": self.time, "reference": self.reference, "output": self.output, "command": self.command}
        thin = {k: np.asarray(v)[index].astype(np.float32) for k, v in {**self.signals, **arrays}.items()}
        return {**thin, "failed": np.array(not self.complete)}

"""A model whose records came from another clock by straight lines: its predictions are taken by the same lines."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cable_envs.diagnosis.model.model import Around, Model


class InLines(Around):
    """A model of which every prediction goes from one clock to the other by straight lines.

    Parameters
    ----------
    model : Model
        Of the records as if their samples had been taken when their stamps say.
    by : sequence of sparse array
        What straight lines make of the samples of each block [T, T].
    """

    def __init__(self, model: Model, by: Sequence[Any]):
        super().__init__(model)
        self._by = list(by)

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        return [by @ p for by, p in zip(self._by, self._model.predict(values), strict=True)]

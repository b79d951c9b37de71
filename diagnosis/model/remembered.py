"""Predictions that were made are kept: refits that go on from where others ended ask for the same columns again.

Each refit begins with the prediction of the values at which another ended, under another noise or on other records, and
takes its slopes there with the same steps. A simulation knows nothing of noise, so that these are the same columns.
"""

from collections import OrderedDict
from typing import Any

import numpy as np

from cable_envs.diagnosis.model.model import Around, Model

LIMIT = 1 << 27
"""Bytes of predictions that are kept, at the most: 350 columns of two minutes of four channels at 100 Hz."""


class Remembered(Around):
    """A model that predicts each column of values once, as long as it is kept.

    What was asked for last is kept longest. Columns are the same where all their bytes are.

    Parameters
    ----------
    model : Model
        Whose prediction of a column depends on nothing but that column, and on its steps of integration.
    limit : int
        Bytes that are kept, at the most.
    """

    def __init__(self, model: Model, limit: int = LIMIT):
        super().__init__(model)
        self._kept: OrderedDict[tuple[Any, bytes], np.ndarray] = OrderedDict()
        self._limit, self._size = limit, 0

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`; the arrays are the caller's own."""
        steps = getattr(self._model, "substeps", None)
        keys = [(steps, column.tobytes()) for column in values.T]
        new = {key: k for k, key in enumerate(keys) if key not in self._kept}
        found = {key: self._kept[key] for key in keys if key in self._kept}
        if new:
            made = np.concatenate(self._model.predict(values[:, list(new.values())]))
            found |= {key: made[:, k].copy() for k, key in enumerate(new)}
        self._keep(found)
        together = np.stack([found[key] for key in keys], axis=1)
        ends = np.cumsum([len(block.time) for block in self.blocks])
        return np.split(together, ends[:-1])

    def _keep(self, found: dict[tuple[Any, bytes], np.ndarray]) -> None:
        """Keep columns as those that were asked for last; what is too much then is forgotten, the oldest first."""
        for key, series in found.items():
            if key not in self._kept:
                self._size += series.nbytes
            self._kept[key] = series
            self._kept.move_to_end(key)
        while self._size > self._limit:
            _, oldest = self._kept.popitem(last=False)
            self._size -= oldest.nbytes

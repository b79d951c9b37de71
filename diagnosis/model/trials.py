"""Trials of parameters that a plant refuses: each costs itself, and nothing else.

The bounds of single parameters cannot exclude all that makes no rig (a pretension above the tension at which the cable
breaks). What the plant refuses is predicted as NaN, as a simulation that runs away is, so that no refit goes there.
"""

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.model.model import Around


class Trials(Around):
    """A model whose predictions are NaN for the columns that its plant refuses.

    Parameters
    ----------
    model : Model
        Whose plant raises ConfigurationError for all columns where one of them makes no rig.
    """

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`; where columns are refused, halves of them are asked apart."""
        try:
            return self._model.predict(values)
        except ConfigurationError:
            count = values.shape[1]
            if count == 1:
                return [np.full((len(block.time), 1), np.nan) for block in self.blocks]
            parts = [self.predict(values[:, : count // 2]), self.predict(values[:, count // 2 :])]
            return [np.concatenate(pair, axis=1) for pair in zip(*parts, strict=True)]

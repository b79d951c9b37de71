"""Channels beside the simulator with the numbers that the recording states, before any of them is refitted.

Where all numbers of the physics are stated, a right simulator predicts the size of every channel but for what it lacks.
A channel that has the predicted course in another size, by more than half way to the next unit, is in another unit.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.factors import ALIKE, HALF, OF_FORCES, OF_RATES, hint
from cable_envs.diagnosis.intake.tracks import EFFORTS, Fault
from cable_envs.diagnosis.model.model import Model
from cable_envs.diagnosis.systems.question import Question


def off_claims(recording: Recording, question: Question) -> list[Fault]:
    """Channels in another unit, by the simulator as it is stated; none where the recording leaves a number open.

    Parameters
    ----------
    recording : Recording
        Says which numbers are stated.
    question : Question
        Its model (`cable_envs.diagnosis.systems.prepare`).
    """
    stated = {*recording.known, *recording.nominal, *(recording.rig.values if recording.rig else ())}
    if not question.nominals or set(question.nominals) - set(question.nuisance) - stated:
        return []
    return off_prediction(question.fit, {}, "with the stated numbers")


def off_prediction(model: Model, values: Mapping[str, float], numbers: str) -> list[Fault]:
    """Channels that a model predicts in their course and in another size, or with the other sign.

    Parameters
    ----------
    model : Model
        With the records.
    values : mapping of str to float
        Of its parameters; those that are not here are where refits start.
    numbers : str
        What these values are called.
    """
    predicted = model.predict(np.array([[values.get(p.name, p.start)] for p in model.parameters]))
    series: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for block, out in zip(model.blocks, predicted, strict=True):
        good = block.good & np.isfinite(block.measured) & np.isfinite(out[:, 0])
        if good.any():
            one, other = block.measured[good], out[good, 0]
            series.setdefault(block.channel, []).append((one - np.mean(one), other - np.mean(other)))
    found = []
    for channel, pairs in series.items():
        seen, said = (np.concatenate(side) for side in zip(*pairs, strict=True))
        over = float(np.sqrt((seen @ seen) * (said @ said)))
        if over == 0.0 or abs(float(seen @ said)) / over < ALIKE:
            continue
        ratio = float(np.sqrt((seen @ seen) / (said @ said))) * float(np.sign(seen @ said))
        if 1.0 / HALF < ratio < HALF:
            continue
        text = f"{ratio:.3g} times what the simulator {numbers} makes of it, in the same course"
        known = hint(ratio, OF_FORCES if channel in EFFORTS else OF_RATES)
        found.append(Fault(model.blocks[0].record, channel, 1, f"{text}: {known}"))
    return found

"""A hidden rig: drawn from a seed and its number, sealed by a salted hash before anybody prepares for it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.rigs import load_rig
from cablebench.concealed.mechanism import LAWS, Mechanism

KINDS = ("one effect", "two effects", "a law of no library")
"""What is concealed in the rigs, one after another: each kind in a third of them."""


@dataclass(frozen=True)
class HiddenRig:
    """One hidden rig.

    Attributes
    ----------
    mechanism : str
        Name of its mechanism.
    number : int
        Its number in the track.
    kind : str
        One of `KINDS`.
    parameters : mapping of str to float
        True values of what nobody knows exactly, SI.
    effects : mapping of str to mapping
        What is concealed: effect -> its numbers, SI.
    law : str
        File of `cablebench.concealed.mechanism.LAWS` that an effect is from; empty: all are from the library.
    """

    mechanism: str
    number: int
    kind: str
    parameters: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]]
    law: str = ""

    def key(self) -> dict[str, Any]:
        """All of it in JSON types, to be sealed."""
        return asdict(self)

    def options(self, mechanism: Mechanism) -> dict[str, Any]:
        """Environment options of the hidden rig, for the task and for the bench alike."""
        rig = {**load_rig(mechanism.preset).replace(self.parameters).content(), "name": "hidden"}
        own = {"effect_file": str(LAWS / f"{self.law}.py")} if self.law else {}
        return {"rig": rig, **own, "effects": {name: dict(numbers) for name, numbers in self.effects.items()}}


def from_key(key: Mapping[str, Any]) -> HiddenRig:
    """The rig of an opened key; ConfigurationError where it is none."""
    try:
        return HiddenRig(**key)
    except TypeError as error:
        raise ConfigurationError(f"this is no key of a hidden rig: {error}") from error


def drawn(mechanism: Mechanism, seed: int, number: int) -> HiddenRig:
    """The hidden rig of a number; it does not depend on how many others there are.

    Parameters
    ----------
    mechanism : Mechanism
    seed : int
        Of the track. Whoever knows it knows the rigs.
    number : int
        From 0.

    Returns
    -------
    HiddenRig

    Examples
    --------
    >>> from cablebench.concealed.mechanism import load_mechanism
    >>> drawn(load_mechanism("hole"), 1, 5).kind
    'a law of no library'
    """
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    values = load_rig(mechanism.preset).values
    parameters = {
        name: values[name] * float(np.exp(mechanism.believed_off * rng.standard_normal()))
        for name in mechanism.uncertain
    }
    if kind == KINDS[2]:
        law = str(rng.choice(sorted(mechanism.outside)))
        numbers = {name: _number(span, rng) for name, span in mechanism.outside[law].items()}
        return HiddenRig(mechanism.name, number, kind, parameters, {law: numbers}, law)
    chosen = rng.choice(sorted(mechanism.library), 1 + KINDS.index(kind), replace=False)
    effects: dict[str, dict[str, float]] = {}
    for name in map(str, chosen):
        effect, parameter = name.split(".")
        effects[effect] = {parameter: _number(mechanism.library[name], rng)}
    return HiddenRig(mechanism.name, number, kind, parameters, effects)


def _number(span: Any, rng: np.random.Generator) -> float:
    if isinstance(span, Mapping):
        low, high = span["uniform"]
        return float(rng.uniform(low, high))
    low, high = span
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))

"""What one recording asks of the diagnosis, whatever its system is."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model
from cable_envs.effects import Effect


@dataclass(frozen=True)
class Request:
    """What the caller wants looked for.

    Parameters
    ----------
    only, without : tuple of str
        Canonical names of effects to look for (None: all), and not to look for.
    own : tuple of Effect
        Effects of the user's own, from `--effect-file`.
    rig : Mapping of str to float, optional
        Values and effects of a rig file that replace those of the recording (an augmented rig), SI.
    variant : str
        "analytic" or "chain": which form of a circuit is held against the recording; "": as its rig says, else
        the chain.
    contacts : int, optional
        At how many places the simulator rubs, where ``rig`` is of a plant that says it; None: as the recording has it.
    simulator : Simulator, optional
        A user's own (`cable_envs.diagnosis.simulators`), which no module of this package knows.
    """

    only: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    own: tuple[Effect, ...] = ()
    rig: Mapping[str, float] | None = None
    variant: str = ""
    contacts: int | None = None
    simulator: Any = None


@dataclass(frozen=True)
class Look:
    """What of a record a model uses: ``spacing``, s between samples (0: all), less ``edge`` s at either end.

    averages: whether it averages its predictions where samples are means (`cable_envs.diagnosis.data.record.Record`).
    told: channels that are commands whatever they are called.
    """

    spacing: float = 0.0
    edge: float = 0.0
    averages: bool = False
    told: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Origin:
    """One number of a simulator.

    Parameters
    ----------
    name, unit, meaning : str
        Of the plant's parameter.
    value : float
        SI; of a fitted one where the refit starts.
    status : str
        "fitted": the refit moves it; else "stated" by the user, or "assumed".
    source : str
        What states it ("known", "nominal", "rig NAME", "conditions"), or where the assumption is from.
    stated : bool
        Whether the user gave the value, the start of a fitted one too.
    """

    name: str
    value: float
    unit: str
    meaning: str
    status: str
    source: str
    stated: bool


@dataclass(frozen=True)
class Question:
    """The models of the records to fit and of those held out, what is refitted, and what may be missing.

    Parameters
    ----------
    system : str
        The plant.
    fit, heldout : Model
        With the same ``parameters`` in the same order.
    nominals : tuple of str
        Parameters that every refit moves.
    nuisance : tuple of str
        Those of them that are no physics of the rig: offsets, the drive's own control.
    hypotheses : tuple of Hypothesis
        What may be missing.
    units : Mapping of str to str
        Unit of every parameter, for people.
    rig : callable
        (parameter values, names of accepted hypotheses) -> content of augmented.yaml.
    notes : tuple of str
        What a person should know of how the recording was read.
    at_rest : bool
        Whether what a right model leaves is what the sensors show at rest; not where a recorded signal, noise and all,
        drives the simulator, or where the model's own error is expected.
    ways : tuple of str
        For people: what motion with a rising, and with a falling position is called.
    origins : tuple of Origin
        Where the simulator's numbers come from.
    not_asked : Mapping of str to str
        Hypothesis that is not among ``hypotheses``, or a parameter that is left out of one -> why, in plain words.
    """

    system: str
    fit: Model
    heldout: Model
    nominals: tuple[str, ...]
    nuisance: tuple[str, ...]
    hypotheses: tuple[Hypothesis, ...]
    units: Mapping[str, str]
    rig: Callable[[Mapping[str, float], Sequence[str]], dict[str, Any]]
    notes: tuple[str, ...] = field(default=())
    at_rest: bool = False
    ways: tuple[str, str] = ("moving forward", "moving backward")
    not_asked: Mapping[str, str] = field(default_factory=dict)
    origins: tuple[Origin, ...] = ()


def stated_of(recording: Recording, question: Question) -> dict[str, float]:
    """Channel -> standard deviation of its noise as stated, SI, where that is all that a right model leaves."""
    return dict(recording.noise) if question.at_rest else {}

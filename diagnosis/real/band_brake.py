"""Band brake (Coble et al. 2022): dry friction alone against what displacement, force and both tensions ask for."""

from collections.abc import Callable
from dataclasses import dataclass

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.real.finding import Finding, find

EXPECTED = ("load_dependent_friction", "backlash", "presliding_hysteresis")
WRONG = "viscous_friction"


@dataclass(frozen=True)
class BandBrake:
    """What was found, and viscous friction beside.

    Parameters
    ----------
    finding : Finding
        The answer.
    viscous : EffectGain
        Viscous friction as the only effect.
    viscous_last : float, optional
        Its log odds on top of the answer; None where others were ahead by far.
    """

    finding: Finding
    viscous: EffectGain
    viscous_last: float | None


def band_brake(recording: Recording, tell: Callable[[str], None] = lambda text: None) -> BandBrake:
    """Fitted at 0.5 Hz, held out at 1 Hz."""
    tell("band brake")
    finding = find("band brake", recording, tell=tell)
    viscous = next(a for a in finding.alone if a.hypothesis.name == WRONG)
    return BandBrake(finding, viscous, finding.further.get(WRONG))

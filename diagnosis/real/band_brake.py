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
    """``viscous``: viscous friction as the only effect; ``viscous_last``: its held-out gain on top of the answer."""

    finding: Finding
    viscous: EffectGain
    viscous_last: float


def band_brake(recording: Recording, tell: Callable[[str], None] = lambda text: None) -> BandBrake:
    """Fitted at 0.5 Hz, held out at 1 Hz."""
    tell("band brake")
    finding = find("band brake", recording, tell=tell)
    viscous = next(a for a in finding.alone if a.hypothesis.name == WRONG)
    return BandBrake(finding, viscous, finding.further[WRONG])

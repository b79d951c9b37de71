"""What a selection finds: the steps from the nominal refit to the last model, and the reasons."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cable_envs.diagnosis.adequacy.bands import Bands
from cable_envs.diagnosis.adequacy.tests import Adequacy
from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.fit.score_tests import ScoreTests
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.search.comparison import Candidate
from cable_envs.diagnosis.search.rules import Rules


@dataclass(frozen=True)
class Selection:
    """The steps from the nominal refit to the last model, and the reasons."""

    null: Judged
    final: Judged
    accepted: tuple[EffectGain, ...]
    score_tests: tuple[ScoreTests, ...]
    tried: tuple[tuple[Candidate, ...], ...]
    before: Adequacy
    after: Adequacy
    adequate: bool
    refused: Mapping[str, str] = field(default_factory=dict)
    rules: Rules = field(default_factory=Rules)
    steps: tuple[EffectGain, ...] = ()
    """of the stepwise selection, where the held-out records judge (`cable_envs.diagnosis.search.heldout`)"""
    further: Mapping[str, float] = field(default_factory=dict)
    """there, the held-out gain of every hypothesis that was refitted on top of the last model"""
    explained: float = 0.0
    """what the effects gain on all records that are asked whether what is left is noise, and what those that the rig
    has already gain on the fitted ones"""
    bands: Bands | None = None
    """spectra of the last model, where it was judged by these; ``after`` is then of them"""

    @property
    def verdict(self) -> str:
        """As in the specification."""
        if not self.adequate:
            return "unknown"
        if not self.accepted:
            return "no_detectable_mismatch"
        return "equivalence_class" if any(a.alternatives for a in self.accepted) else "named"

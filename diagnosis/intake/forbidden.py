"""What physics forbids, of all records together, before anything is fitted: checks in the order of their asking.

    blocks_twice, out_of_order, mixed_units, held,
    piled, spikes, jumps                              what happens once, which may look like a shift
    wrong_factors, late_channels, against_nature      units, clocks, signs and columns

Each takes (recording, tracks) and yields `cable_envs.diagnosis.intake.tracks.Found`.
"""

from cable_envs.diagnosis.intake.energy import against_nature
from cable_envs.diagnosis.intake.factors import wrong_factors
from cable_envs.diagnosis.intake.jumps import jumps, mixed_units, out_of_order, spikes
from cable_envs.diagnosis.intake.repeats import blocks_twice, held, piled
from cable_envs.diagnosis.intake.timing import late_channels

CHECKS = (
    blocks_twice, out_of_order, mixed_units, held, piled, spikes, jumps, wrong_factors, late_channels, against_nature,
)  # fmt: skip
"""Of records whose clocks are even but for short gaps. Where one finds what cannot be used, the next are not asked."""

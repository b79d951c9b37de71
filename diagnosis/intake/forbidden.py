"""What physics forbids, of all records together, before anything is fitted: checks in the order of their asking.

    blocks_twice, mixed_units, held, spikes    what happens once; it may look like a shift or a wrong factor
    wrong_factors, against_nature              units, signs and columns

`jumps.jumps` and `timing.late_channels` are not asked yet: they refuse good recordings of limit cycles, whose stick and
slip looks like lost counts, and of motions that are slow against their noise, whose shift is not determined.

Each takes (recording, tracks) and yields `cable_envs.diagnosis.intake.tracks.Found`.
"""

from cable_envs.diagnosis.intake.energy import against_nature
from cable_envs.diagnosis.intake.factors import wrong_factors
from cable_envs.diagnosis.intake.jumps import mixed_units, spikes
from cable_envs.diagnosis.intake.repeats import blocks_twice, held

CHECKS = (blocks_twice, mixed_units, held, spikes, wrong_factors, against_nature)
"""Of records whose clocks are even but for short gaps. Where one finds what cannot be used, the next are not asked."""

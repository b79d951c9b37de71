"""A cable transmission between two torque sensors, quasi-static: what the output does, given the drive.

Geometry, tensions and idlers are not known, so the circuit is lumped into friction contacts and two springs, in the
drive's units: x drive angle, M drive torque less its sensor's zero and a spring on the drive, w the torque behind the
friction, u that at the output.

contact     closing (M < 0 pulls):  M = w e^l - c          opening:  M = w e^-l + c
            l is the capstan's or bearings' exponent over the whole path (Zou 2022 Eq. 12-13: tension ratio of a
            wrap; both signs), c the part without load: dry friction, or l times a pretension (cannot be told apart)
sticking    set-valued: w stays as it is while M is between the two, else it is at the nearer one (play operator of
            the torque: it knows no motion, so a pull that falls while the output still goes the same way leaves w
            where it was). By the sign of the motion instead: the one or the other, whatever the torque's history
two         a share of l and c in a contact at the drive, with a spring between, then the rest: slip arrives later
springs     e = sum over both ends of C 2 T / (1 + sqrt(1 + 2 h |T|)): Hooke, stiffening as
            `cable_envs/effects/stiffness_hardening.py` has it, here for torques
output      angle = ratio x + zero + s (sin 2x - 2x) + k (cos 2x - 1) - e ;  torque = w / (ratio scale) - spring

s and k are a ripple of half a turn whose straight part is in the ratio. All arrays are SI.
"""

import numpy as np

from cable_envs.core.kernels import jit

ROWS = (
    "ratio", "torque_zero", "torque_constant", "sensor_scale.output_torque", "cable_elongation.drive_side",
    "cable_elongation.output_side", "stiffness_hardening.drive_side", "stiffness_hardening.output_side",
    "coulomb_friction.level", "load_dependent_friction.exponent", "presliding_hysteresis.share",
    "partial_slip.share", "partial_slip.compliance", "viscous_friction.coefficient", "stribeck_friction.excess",
    "stribeck_friction.velocity", "backlash.width", "viscoelastic_creep.share", "viscoelastic_creep.time",
    "friction_drift.change", "position_ripple.sine", "position_ripple.cosine", "position_dependent_load.drive_side",
    "position_dependent_load.output_side", "sensor_delay.output_angle",
)  # fmt: skip
"""Rows of the parameter columns; the zero of the output angle is added outside."""

DRIFT_TIME = 10.0
"""s over which friction changes by `friction_drift.change`."""


@jit
def _stretch(torque, compliance, hardening):
    """Angle that a stiffening spring gives way under a torque of either sign."""
    return compliance * 2.0 * torque / (1.0 + np.sqrt(1.0 + 2.0 * hardening * abs(torque)))


@jit
def _contact(torque, exponent, level, share, way, stuck):
    """(torque behind a contact, its set-valued part); ``stuck``: that part a step before."""
    growth = np.exp(exponent)
    low, high = torque - level, torque + level
    low = low * growth if low < 0.0 else low / growth
    high = high / growth if high < 0.0 else high * growth
    held = min(max(stuck, low), high)
    return share * held + (1.0 - share) * (high if way < 0.0 else low), held


@jit
def transmit(period, x, torque, speed, way, p, angle, wrench):
    """Output angle less its zero, and output torque, of one record for every column.

    period s; x, torque, speed, way (direction of motion, 1 or -1): [T]; p: [len(ROWS), n] in the order of `ROWS`;
    angle, wrench: [n, T], written.
    """
    steps = len(x)
    for j in range(p.shape[1]):
        (ratio, zero, constant, scale, soft_drive, soft_out, hard_drive, hard_out, level, exponent, share,
         first, between, viscous, excess, stribeck, gap, creep, creep_time, drift, sine, cosine, spring_drive,
         spring_out, delay) = (
            p[0, j], p[1, j], p[2, j], p[3, j], p[4, j], p[5, j], p[6, j], p[7, j], p[8, j], p[9, j], p[10, j],
            p[11, j], p[12, j], p[13, j], p[14, j], p[15, j], p[16, j], p[17, j], p[18, j], p[19, j], p[20, j],
            p[21, j], p[22, j], p[23, j], p[24, j],
        )  # fmt: skip
        keep = np.exp(-period / creep_time)
        held_first, held_last, crept, y = way[0] * -1e9, way[0] * -1e9, 0.0, 0.0
        for i in range(steps):
            felt = constant * torque[i] - zero
            grown = 1.0 + drift * (i * period / DRIFT_TIME)
            dry = max((level + excess * np.exp(-((speed[i] / stribeck) ** 2))) * grown, 0.0)
            wrap = exponent * grown
            free = felt - spring_drive * x[i] - viscous * speed[i]
            middle, held_first = _contact(free, wrap * first, dry * first, share, way[i], held_first)
            last, held_last = _contact(middle, wrap * (1.0 - first), dry * (1.0 - first), share, way[i], held_last)
            out = last / (ratio * scale) - spring_out * x[i]
            elastic = _stretch(felt, soft_drive, hard_drive) + _stretch(out, soft_out, hard_out)
            elastic += _stretch(middle, between, hard_out)
            target = creep * elastic
            crept = target if i == 0 else target + (crept - target) * keep
            path = ratio * x[i] + sine * (np.sin(2.0 * x[i]) - 2.0 * x[i]) + cosine * (np.cos(2.0 * x[i]) - 1.0)
            path -= elastic + crept
            y = path if i == 0 else min(max(y, path - 0.5 * gap), path + 0.5 * gap)
            angle[j, i], wrench[j, i] = y, out
        if delay > 0.0:
            late = delay / period
            for i in range(steps - 1, -1, -1):
                place = max(i - late, 0.0)
                k = min(int(place), max(i - 1, 0))
                angle[j, i] = angle[j, k] + (place - k) * (angle[j, min(k + 1, i)] - angle[j, k])

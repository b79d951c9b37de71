"""The circuit's drive in continuous time: the ideal one, or one with a motor."""

from cable_envs.core.kernels import clip, select
from cable_envs.physics.servo import placing
from cable_envs.plants.continuous import Rows, limited
from cable_envs.plants.servo_rates import driven_by


def turned(rows: Rows, a, v, m_in, servo, drive_way):
    """(acceleration, rates of the servo's states, what the motor shows) of the drive at the angle a, against M_in.

    ``drive_way``: the direction in which a drive with a motor slides; empty where it is ideal.
    """
    if drive_way:
        d = rows.x
        faster, rates = driven_by(d, rows.p, rows.u, a, v, drive_way[0], m_in, servo)
        return faster, rates, (d.motor_current[0], d.motor_torque[0])
    return _ideal(rows.p, rows.u, a, v, m_in), (), ()


def _ideal(p, u, a, v, m_in):
    """What `circuit.ends.drive_step` steps."""
    fastest = p.drive_speed_limit[0]
    rate = clip(u.command_rate[0], -fastest, fastest)
    k, d, most = p.servo_stiffness[0], p.servo_damping[0], p.drive_acceleration_limit[0]
    servo = placing(a, v, u.command[0], rate, k, d, most)
    torque = clip(u.command[0], -p.drive_torque_limit[0], p.drive_torque_limit[0])
    pushed = (torque - p.drive_damping[0] * v - m_in) / p.drive_inertia[0]
    return limited(v, select(u.mode[0] > 0.5, pushed, servo), fastest)

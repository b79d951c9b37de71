"""The closed pulley circuit in continuous time, by its closed forms; the chain is in `circuit.chain_continuous`.

position   theta_in'' = w^2 (command - theta_in) + 2 z w (command_rate - theta_in'),   within the drive's limits
torque     J_in theta_in'' = command - b theta_in' - M_in
output     J theta_out'' = M_out - load,   M_out by the direction of motion; the brake and the friction of the
           idlers are set-valued at rest, and the friction mobilised there is what balances the load
"""

from dataclasses import replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.circuit import chain_continuous as chain
from cable_envs.plants.circuit.closed_form import _stretched
from cable_envs.plants.circuit.drive_rates import turned
from cable_envs.plants.circuit.ends import cosine, load_torque
from cable_envs.plants.circuit.stages import cw_share, drive_torque, mix, output_torques
from cable_envs.plants.continuous import Equations, Rows, Values, driven, rubbed
from cable_envs.plants.servo_rates import with_motors


def _law(state, rows: Rows, way, *drive_way):
    a, v_in, b, v, *servo = state
    p, u = rows.p, rows.u
    top, bottom = _stretched(p, None, None, 0, p.gear[0] * a - b, p.gear[0] * v_in - v)
    wanted, _, _ = load_torque(p, u, 0, b, v, cosine(b))
    ccw, cw = output_torques(p, 0, top, bottom)
    share = cw_share(way, ccw, cw, wanted)
    brake = p.brake_torque[0]
    net = rubbed(ccw + share * (cw - ccw) - wanted, brake, brake, way)
    m_in = drive_torque(p, 0, top, bottom, share)
    shown = (
        m_in,
        p.output_radius[0]
        * (
            top * mix(share, p.output_top_ccw[0], p.output_top_cw[0])
            - bottom * mix(share, p.output_bottom_ccw[0], p.output_bottom_cw[0])
        ),
        top * mix(share, p.drive_top_ccw[0], p.drive_top_cw[0]),
        bottom * mix(share, p.drive_bottom_ccw[0], p.drive_bottom_cw[0]),
        top * mix(share, p.output_top_ccw[0], p.output_top_cw[0]),
        bottom * mix(share, p.output_bottom_ccw[0], p.output_bottom_cw[0]),
    )
    faster, servo_rates, motor = turned(rows, a, v_in, m_in, servo, drive_way)
    return (v_in, faster, v, net / p.output_inertia[0], *servo_rates), (a, v_in, b, v, *shown, *motor)


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of the closed form, or of the chain; ConfigurationError for what has none."""
    closed = Equations(
        states=("drive_angle", "drive_velocity", "output_angle", "output_velocity"),
        inputs=driven(
            mode, mode.name == "position", Signal("disturbance", "N m", "torque that helps counter-clockwise motion")
        ),
        outputs=(
            "drive_angle", "drive_velocity", "output_angle", "output_velocity", "drive_torque", "output_torque",
            "tension_drive_top", "tension_drive_bottom", "tension_output_top", "tension_output_bottom",
        ),
        law=_law,
        place="output_angle",
        slides=("output_velocity",),
        slack={_stretched: "length_top"},
        speed=1e-2,
    )  # fmt: skip
    loose = () if value["brake_torque"] > 0.0 else ("output_velocity",)
    ideal = replace(closed, states=chain.STATES, law=chain.law, verge=chain.verge, slack={}, free=loose)
    if plant.name != "pulley_chain":
        ideal = closed
        if value["hold_rule"] > 0.5:
            raise ConfigurationError(
                "hold_rule 1 stops the output within no time where the flag of Eq. (47) is set; use 0"
            )
    elif value["cable_damping"] <= 0.0:
        raise ConfigurationError(
            "the chain needs a cable_damping above 0 in continuous time: without it the rates of its slips do not "
            "follow from its state"
        )
    if plant.drive == "ideal":
        return ideal
    return with_motors(ideal, value, mode.name == "position", force="torque")

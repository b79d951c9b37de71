"""A drive with a motor that moves along the cable: at the hole, at holes in series and at the sheath."""

import gymnasium as gym
import numpy as np
import pytest

from cable_envs import load_rig
from cable_envs.core.inputs import INPUTS
from cable_envs.physics.hole_ratio import EXACT, hole_ratio
from tests.reference.motor_reference import HolesWithMotor, Motor, stuck_or_sliding

HOLE, SHEATH = "gu-steel-1mm-motor", "bowden-1m-motor"
PERIOD = 0.01
SERIES = {"plant": "cable_hole", "extends": HOLE, "holes": 3, "parameters": {"load_mass": 2.0, "span_stiffness": 2e5}}


def driven(rig, changes: dict, command, mode: str, substeps: int = 20, steps: int = 150):
    """(values by name, signals by name [T]) of a rig that follows a command of the time, at the control period."""
    made = load_rig(rig).replace(changes)
    plant = made.simulated_by()
    values = made.column(plant)
    p = plant.prepare(values if made.effects else values[: len(plant.parameters)])
    x, u = plant.rest(p, np.zeros(1)), INPUTS.zeros(1)
    u.mode[:] = [one.name for one in plant.action_modes].index(mode)
    seen = []
    for k in range(steps):
        u.command[:] = command(PERIOD * k)
        u.command_rate[:] = (command(PERIOD * k) - command(PERIOD * (k - 1))) / PERIOD
        plant.advance(x, p, u.rows, 0, 1, substeps, PERIOD / substeps)
        seen.append(x[: len(plant.signals), 0].copy())
    return made.values, dict(zip([s.name for s in plant.signals], np.array(seen).T, strict=True))


def agree(seen, name: str, path) -> None:
    apart = np.sqrt(np.mean((np.array(path) - seen[name]) ** 2)) / np.ptp(seen[name])
    assert apart < 0.01, (name, apart)


@pytest.mark.slow
@pytest.mark.parametrize("rig", [HOLE, SERIES], ids=["hole", "series"])
def test_a_drive_within_its_gap_moves_as_without_a_cable(rig):
    """The nut is held by its friction, and with it the cable. That of the other rig pulls with a millinewton."""
    weak = {"cable_stiffness": 1.0, "cable_damping": 0.0, "load_gravity": 0.0, "load_stiffness": 1.0}
    smooth, paths = {"encoder_counts": 0.0}, []
    for changes in (weak, {"backlash.gap": 3e-3}):
        _, seen = driven(rig, smooth | changes, lambda t: 2e-3 * np.pi * np.cos(2.0 * np.pi * t), "speed", steps=100)
        paths.append(seen["drive_position"] - seen["drive_position"][0])
    assert paths[1] == pytest.approx(paths[0], abs=2e-7) and np.ptp(paths[1]) > 1.9e-3
    assert np.ptp(seen["load_position"]) == np.ptp(seen["drive_tension"]) == 0.0 and seen["drive_tension"][0] > 19.0


@pytest.mark.parametrize("rig", [HOLE, pytest.param(SERIES, marks=pytest.mark.slow)], ids=["hole", "series"])
def test_a_drive_that_is_told_its_force_has_its_gap_taken_up(rig):
    """The cable can only pull: it draws the nut to one edge, and the motion is that without a gap, to the bit."""
    without, taken_up = (
        driven(rig, {"backlash.gap": gap, "slack.length": 1e-9}, lambda t: 49.0 + 25.0 * np.sin(4.0 * t), "tension")[1]
        for gap in (0.0, 2e-3)
    )
    assert np.ptp(without["load_position"]) > 1e-3
    for name in without.keys() - {"servo_integral"}:  # told its force, the drive has no use for it
        np.testing.assert_array_equal(taken_up[name], without[name], err_msg=name)


@pytest.mark.parametrize(
    ("mode", "command"),
    [
        ("tension", lambda t: 49.0 + 25.0 * np.sin(4.0 * t)),
        ("speed", lambda t: 0.01 * np.cos(6.0 * t)),
    ],
)
def test_the_hole_moves_as_its_equations_in_short_explicit_steps(mode, command):
    """Drive, cable, hole and load in 10 us steps, written down once more."""
    changes = {"encoder_counts": 0.0, "cogging_torque": 2e-3}
    q, seen = driven(HOLE, changes, command, mode, substeps=40)
    weight, dt = q["load_mass"] * q["gravity"], 1e-5
    drive, y, v, paths = (
        Motor(q, weight / q["cable_stiffness"], weight, "tension_command_limit"),
        0.0,
        0.0,
        {"drive_position": [], "load": []},
    )
    hole = [q[name] for name in (
        "wrap_angle", "radius_ratio", "friction_coefficient", "extrusion_delta", "extrusion_gain",
        "extrusion_exponent",
    )]  # fmt: skip
    for k in range(150_000):
        told = command(PERIOD * (k // 1000))
        if mode == "tension":
            drive.asked = min(max(told, 0.0), q["tension_command_limit"])
        elif k % 100 == 0:
            drive.read(drive.target, drive.pace)
        most = dt * q["drive_acceleration_limit"]
        drive.target += dt * drive.pace
        drive.pace += min(max(told - drive.pace, -most), most)
        above = q["cable_stiffness"] * (drive.at - y) + q["cable_damping"] * (drive.v - v)
        above = max(above, 0.0) if drive.at > y else 0.0
        n = hole_ratio(EXACT, v, *hole, 0.0, 1.0, 1.0, 1.0)
        drive.move(above, dt)
        v = stuck_or_sliding(v, above / n - weight, above * n - weight, q["load_mass"], dt)
        y += dt * v
        if (k + 1) % 1000 == 0:
            paths["drive_position"].append(drive.at)
            paths["load"].append(y)
    agree(seen, "drive_position", paths["drive_position"])
    agree(seen, "load_position", paths["load"])


@pytest.mark.parametrize("holes", [3, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("mode", "command"),
    [
        ("tension", lambda t: 30.0 + 15.0 * np.sin(4.0 * t)),
        ("speed", lambda t: 0.01 * np.cos(6.0 * t)),
    ],
)
def test_holes_in_series_move_as_their_equations_in_short_explicit_steps(mode, command, holes):
    """Motor and load in 20 us steps; which inner holes slip, and how far, from dense equations for each step."""
    series = {**SERIES, "holes": holes}
    changes = {"encoder_counts": 0.0, "cogging_torque": 2e-3, "extrusion_gain": 0.0, "cable_damping": 0.0}
    changes |= {f"friction_coefficient{one}": 0.283 for one in ("", *(f"_{h}" for h in range(2, holes + 1)))}
    q, seen = driven(series, changes, command, mode, substeps=40, steps=100)
    ratio = hole_ratio(EXACT, 0.0, q["wrap_angle"], q["radius_ratio"], q["friction_coefficient"], q["extrusion_delta"],
                       0.0, 1.0, 0.0, 1.0, 1.0, 1.0)  # fmt: skip
    _, fine = driven(series, changes, command, mode, substeps=400, steps=100)
    other = HolesWithMotor(q, ratio, holes, 2e-5)
    told = np.array([other.advance(mode, command(PERIOD * k), 0.0, PERIOD) for k in range(100)]).T
    names = "drive_tension", f"span_tension_{holes - 1}", "drive_position", "load_position"
    coarse, finer = (
        [np.sqrt(np.mean((one[n] - path) ** 2)) / np.ptp(one[n]) for n, path in zip(names, told, strict=True)]
        for one in (seen, fine)
    )
    assert max(coarse[2:]) < 2e-4 and max(finer[2:]) < 5e-5  # the reference's own steps make 2e-5
    assert max(coarse[:2]) < 0.01 and max(finer[:2]) < 1e-3


@pytest.mark.parametrize(
    ("mode", "command"),
    [
        ("position", lambda t: 2e-3 + 0.015 * np.sin(3.0 * t) ** 2),
        ("tension", lambda t: 25.0 + 20.0 * np.sin(4.0 * t)),
    ],
)
def test_the_sheath_moves_as_its_equations_in_short_explicit_steps(mode, command):
    changes = {"encoder_counts": 0.0, "cogging_torque": 2e-3}
    q, seen = driven(SHEATH, changes, command, mode, substeps=40)
    k_whole = 1.0 / (1.0 / q["tendon_stiffness"] + 1.0 / q["sheath_stiffness"])
    rest, r, dt = q["load_preload"], q["friction_coefficient"] * q["bend_angle"], 1e-5
    low, high = r / np.expm1(r), -r / np.expm1(-r)  # T2 / Tm pulled in, paid out
    drive, y, v, paths = Motor(q, rest / k_whole, rest, "tension_command_limit"), 0.0, 0.0, {"drive": [], "load": []}
    for k in range(150_000):
        told = command(PERIOD * (k // 1000))
        if mode == "tension":
            drive.asked = min(max(told, 0.0), q["tension_command_limit"])
        elif k % 100 == 0:
            drive.read(told, (told - command(PERIOD * (k // 1000 - 1))) / PERIOD)
        mean = max(k_whole * (drive.at - y) + q["tendon_damping"] * (drive.v - v), 0.0)
        back = q["load_preload"] + q["load_stiffness"] * y + q["load_damping"] * v
        way = np.sign(v) if v != 0.0 else 0.0
        share = {1.0: low, -1.0: high}.get(way, min(max(back / max(mean, 1e-9), low), high))
        if way:
            mobilised = way * r
        else:  # r / (e^r - 1) = T2 / Tm
            mobilised = inverse(share, r)
        drive.move(mean * (share + mobilised), dt)
        v = stuck_or_sliding(v, mean * low - back, mean * high - back, q["load_mass"], dt)
        y += dt * v
        if (k + 1) % 1000 == 0:
            paths["drive"].append(drive.at)
            paths["load"].append(y)
    agree(seen, "drive_position", paths["drive"])
    agree(seen, "load_position", paths["load"])


def inverse(share: float, most: float) -> float:
    """The r with r / (e^r - 1) = share, within -most and most: Newton's method from its series."""
    r = min(max(2.0 * (1.0 - share), -most), most)
    for _ in range(4):
        if abs(r) < 1e-4:
            return r
        value, slope = r / np.expm1(r), (np.expm1(r) - r * np.exp(r)) / np.expm1(r) ** 2
        r = min(max(r - (value - share) / slope, -most), most)
    return r


@pytest.mark.parametrize(
    ("rig", "mode", "command"),
    [
        (HOLE, "tension", lambda t: 500.0),
        (HOLE, "speed", lambda t: 0.1),
        (SHEATH, "position", lambda t: 0.05),
        (SHEATH, "tension", lambda t: 500.0),
        pytest.param(SERIES, "tension", lambda t: 500.0, marks=pytest.mark.slow),
    ],
    ids=["hole-tension", "hole-speed", "sheath-position", "sheath-tension", "series-tension"],
)
def test_no_command_takes_more_force_or_current_than_the_drive_has(rig, mode, command):
    """The load is held fast by a stiff spring: the motor stops at its saturator."""
    values, seen = driven(rig, {"load_stiffness": 1e5}, command, mode)
    limit = values["tension_command_limit"]
    assert np.abs(seen["servo_force"]).max() == pytest.approx(limit)
    assert np.abs(seen["motor_current"]).max() <= values["motor_current_limit"]
    driving = seen["motor_force"] * seen["drive_velocity"] > 0.0
    assert np.abs(seen["motor_force"][driving]).max() <= values["gear_efficiency"] * limit * (1.0 + 1e-12)
    held = limit / values["gear_efficiency"] + values["drive_friction"]
    assert seen["drive_tension"][-1] <= held and abs(seen["drive_velocity"][-1]) < 1e-4


@pytest.mark.parametrize("rig", [HOLE, SHEATH, SERIES], ids=["hole", "sheath", "series"])
def test_voltage_and_back_emf_set_the_speed_that_is_left(rig):
    """Full force asked for: at a tenth of the voltage the motor gets no faster than that drives it."""
    changes = {"supply_voltage": 2.4, "drive_speed_limit": 10.0, "load_stiffness": 0.0}
    changes |= {"load_preload": 5.0} if rig == SHEATH else {"load_mass": 0.5}
    values, seen = driven(rig, changes, lambda t: 60.0, "tension", substeps=50)
    emf = values["motor_constant"] * values["gear_ratio"] / values["spool_radius"] * seen["drive_velocity"]
    left = (values["supply_voltage"] - emf) / (values["motor_resistance"] + values["supply_resistance"])
    fast = slice(100, None)
    np.testing.assert_allclose(seen["motor_current"][fast], left[fast], rtol=1e-2, atol=1e-3)
    assert 0.7 * values["supply_voltage"] < emf[-1] < values["supply_voltage"]


@pytest.mark.parametrize("rig", [HOLE, SHEATH, SERIES], ids=["hole", "sheath", "series"])
def test_it_stays_at_rest(rig):
    plant = load_rig(rig).simulated_by()
    mode = plant.action_modes[0]
    column = load_rig(rig).column(plant)[: len(plant.parameters)]
    x = plant.rest(plant.prepare(column), np.zeros(1))
    rest = float(x[plant.row(mode.rest_signal), 0])
    seen = driven(rig, {}, lambda t: rest, mode.name, steps=300)[1]
    assert np.ptp(seen["load_position"]) == 0.0 and np.ptp(seen["drive_position"]) == 0.0


@pytest.mark.parametrize(
    ("env_id", "rig"),
    [
        ("cable_envs/CableHole-Position-Sine-v1", HOLE),
        pytest.param("cable_envs/CableHole-Position-Sine-v1", SERIES, marks=pytest.mark.slow),
        ("cable_envs/TendonSheath-Position-Sine-v1", SHEATH),
    ],
    ids=["hole", "series", "sheath"],
)
def test_lanes_are_single_environments_to_the_bit_and_the_agent_sees_the_encoder(env_id, rig):
    options = {"rig": load_rig(rig), "observe": "output"}
    if rig != HOLE:
        options["effects"] = {"backlash": {"gap": 1e-4}}
    many = gym.make_vec(env_id, num_envs=3, vectorization_mode="vector_entry_point", **options)
    alone = [gym.make(env_id, **options) for _ in range(3)]
    first = many.reset(seed=[3, 4, 5])[0]
    np.testing.assert_array_equal(first, [one.reset(seed=s)[0] for one, s in zip(alone, (3, 4, 5), strict=True)])
    channel = [c.name for c in alone[0].unwrapped.channels].index("drive_position")
    scale, rng = alone[0].unwrapped.channels[channel].scale, np.random.default_rng(0)
    for _ in range(40):
        actions = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        together = many.step(actions)[0]
        steps = [one.step(a) for one, a in zip(alone, actions, strict=True)]
        np.testing.assert_array_equal(together, [step[0] for step in steps])
        assert steps[0][0][channel] * scale == pytest.approx(steps[0][4]["encoder_position"], rel=1e-6, abs=1e-9)


def test_readings_are_at_the_ends_of_steps():
    """Steps that the encoder's period is no multiple of would read late, by up to a step."""
    quick = load_rig(SHEATH).replace({"load_mass": 0.02})
    env = gym.make("cable_envs/TendonSheath-Position-Sine-v1", rig=quick)
    assert env.unwrapped.setup.substeps % 10 == 0 and env.unwrapped.setup.substeps > 20

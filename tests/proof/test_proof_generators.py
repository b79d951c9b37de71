"""The generators of the blind proof against closed forms, limits and solvers with tight tolerances."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from cable_envs.proof.effects import find
from cable_envs.proof.rigs import random_rig
from cable_envs.proof.sensors import USUAL, distort, quantise, random_colour, stamps
from cable_envs.proof.simulators import cable_hole, linear_drive, pulley_circuit
from cable_envs.proof.simulators.numerics import slipped, tension_ratio

CLOCK = linear_drive.CLOCK


def _ramp(seconds: float, speed: float, still: float = 0.5) -> np.ndarray:
    t = np.arange(0.0, seconds, CLOCK)
    return speed * np.maximum(t - still, 0.0)


def test_nothing_of_the_simulator_under_test_is_used():
    """No module of the proof imports plants, kernels, effects or the simulation."""
    forbidden = ("plants", "kernels", "simulation", "effects", "contact", "friction", "hole_ratio", "circuit_statics")
    for file in (Path(__file__).parents[2] / "proof").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
            for name in names:
                assert not any(name == f"cable_envs.{m}" or name.startswith(f"cable_envs.{m}.") for m in forbidden), (
                    file
                )


def test_dahl_and_the_stop_dissipate():
    """Exact solutions: 1 - 2 exp(-s / d) after a reversal; the work over a closed path is never negative."""
    assert slipped(-1.0, 2e-4, 1e-6, 1e-4) == pytest.approx(1.0 - 2.0 * math.exp(-2.0), rel=1e-12)
    assert slipped(0.0, 0.5e-6, 1e-6, 0.0) == pytest.approx(0.5) and slipped(0.9, 1.0, 1e-6, 0.0) == 1.0
    path = 1e-4 * np.sin(np.linspace(0, 6 * np.pi, 3001))
    for soft in (0.0, 3e-5, 1e-3):
        z, work = 0.0, []
        for ds in np.diff(path):
            before, z = z, slipped(z, ds, 2e-5, soft)
            work.append(0.5 * (before + z) * ds)
        assert sum(work[1000:2000]) > 0.0  # a whole period, from one peak-free point to its repetition


@pytest.mark.parametrize("rho", [0.5, 1.5, 20.0])
@pytest.mark.parametrize("mu", [0.05, 0.43, 1.2])
def test_tension_ratio_solves_its_equation(rho, mu):
    phi = 1.3
    right = solve_ivp(
        lambda _, y: [y[1], (rho * mu * y[0] - (1 + rho) * y[1]) / mu], (0, phi), [1.0, 0.0],
        method="Radau", rtol=1e-10, atol=1e-12,
    ).y[0, -1]  # fmt: skip
    assert tension_ratio(rho, mu, phi) == pytest.approx(right, rel=1e-7)
    assert tension_ratio(1e9, mu, phi) == pytest.approx(math.exp(mu * phi), rel=1e-6)  # capstan limit


def test_linear_drive_is_the_sampled_linear_system_without_friction():
    """m x'' = u - c x' with u held for a tick has an exact discrete form."""
    m, c, kp, kd = 5.0, 20.0, 4e3, 150.0
    t = np.arange(0.0, 3.0, CLOCK)
    reference = 0.05 * (1.0 - np.cos(3.0 * t))
    made = linear_drive.simulate({"mass": m, "viscous": c, "kp": kp, "kd": kd}, reference)
    step = expm(np.array([[0, 1, 0], [0, -c / m, 1 / m], [0, 0, 0]]) * CLOCK)
    rate, state, right = np.gradient(reference, CLOCK), np.zeros(2), []
    for r, dr in zip(reference, rate, strict=True):
        right.append(state[0])
        u = kp * (r - state[0]) + kd * (dr - state[1])
        state = (step @ [*state, u])[:2]
    # the damping force of a half kick is taken at its start: h c / m / 2 = 4e-4 of the damping force
    assert np.abs(made["position"] - right).max() < 2e-5


def test_linear_drive_against_solve_ivp():
    """Free swing on springs with drag: smooth, so that a solver of high order is the truth."""
    values = {
        "mass": 4.0, "viscous": 1.0, "kp": 0.0, "kv": 0.0, "kd": 0.0, "position_dependent_load.stiffness": 400.0,
        "position_dependent_load.cubic": 3e4, "gusty_drag.coefficient": 2.0, "gusty_drag.wind": 0.0,
    }  # fmt: skip
    made = linear_drive.simulate(values, np.full(3000, 0.08))
    right = solve_ivp(
        lambda _, y: [y[1], -(400 * y[0] + 3e4 * y[0] ** 3 + y[1] + 2 * abs(y[1]) * y[1]) / 4.0],
        (0, 3.0), [0.08, 0.0], t_eval=made["time"], rtol=1e-10, atol=1e-12,
    ).y[0]  # fmt: skip
    assert np.abs(made["position"] - right).max() < 2e-5  # order 2 at 0.2 ms: 1e-6 of phase per period and the damping


def test_linear_drive_at_constant_speed_needs_its_friction():
    values = {"mass": 5.0, "viscous": 30.0, "coulomb": 8.0}
    for extra, more in (
        ({}, 0.0),
        ({"coulomb_friction.force": 2.0}, 2.0),
        ({"stribeck_friction.excess": 3.0, "stribeck_friction.speed": 0.04}, 3.0 * math.exp(-((0.05 / 0.04) ** 2))),
        ({"asymmetric_friction.difference": 1.0}, 1.0),
    ):
        force = linear_drive.simulate({**values, **extra}, _ramp(3.0, 0.05))["force"][-500:]
        assert force.mean() == pytest.approx(8.0 + 30.0 * 0.05 + more, rel=1e-3)


def test_linear_drive_sticks_below_its_friction():
    """A reference off by less than F_c / kp moves the mass by no more than its bristles."""
    reference = np.where(np.arange(2000) < 500, 0.0, 0.8 * 8.0 / 4e3)
    made = linear_drive.simulate({"coulomb": 8.0, "kv": 0.0, "kd": 0.0}, reference)
    assert np.abs(made["position"]).max() < 3 * linear_drive.STIFF
    assert made["force"][-1] == pytest.approx(0.8 * 8.0, rel=0.01)


def test_hole_hauls_and_lowers_by_the_directional_law():
    """T1 = m g lambda hauling and m g / lambda lowering, with the extrusion's part of M at that speed.  G15, G28."""
    m, mu, wrap, speed, gain = 5.0, 0.43, 1.0, 8e-3, 3000.0
    ratio = tension_ratio(1.5, mu + gain * speed**2.03, wrap)
    values = {"load_mass": m, "friction_coefficient": mu, "wrap_angle": wrap, "lateral_extrusion.gain": gain}
    for sign in (1.0, -1.0):
        made = cable_hole.simulate(values, _ramp(3.0, sign * speed))
        assert made["drive_tension"][-1] == pytest.approx(m * 9.81 * ratio**sign, rel=1e-4)
        assert made["load_tension"][-1] == pytest.approx(m * 9.81, rel=1e-4)


def test_hole_at_rest_keeps_what_friction_allows():
    made = cable_hole.simulate({"kp": 0.0}, np.zeros(1000))
    assert np.abs(made["load_position"]).max() < cable_hole.STIFF
    ratio = tension_ratio(1.5, 0.43, 1.047)
    assert 1.0 / ratio <= made["drive_tension"][-1] / (5.0 * 9.81) <= ratio


def test_circuit_in_the_working_phase_follows_zou():
    """Tension ratios of a side, the closure Delta L_t + Delta L_b = 0, and the elongation, Eqs. (34)-(46), Zou 2022."""
    from cable_envs.plants.circuit.statics import Statics

    made = pulley_circuit.simulate({"contact_stiffness": 0.3}, _ramp(2.5, 0.5, 0.3))
    logs, _ = pulley_circuit.contact_logs(0.54, 0.157)
    statics = Statics.from_rig({"contact_stiffness": 0.3})
    assert np.exp(logs.sum(axis=1)) == pytest.approx(statics.product[:, 0], rel=1e-6)
    last = {name: values[-1] for name, values in made.items()}
    elongation = last["drive_angle"] * 7 / 5 - last["output_angle"]
    right = statics.from_elongation(elongation, 1)
    # half of what is wrapped belongs to each span: second order in ln(lambda), some 0.1 % of the tension
    assert last["tension_top"] == pytest.approx(float(right.tension_drive_top[0]), rel=5e-3)
    assert last["tension_bottom"] == pytest.approx(float(right.tension_drive_bottom[0]), rel=5e-3)
    assert last["output_torque"] == pytest.approx(float(right.output_torque[0]), rel=0.03)


def test_circuit_dissipates_and_holds_after_a_reversal():
    t = np.arange(0.0, 9.0, CLOCK)
    made = pulley_circuit.simulate({"contact_angle": -9.0, "contact_stiffness": 0.0}, 0.5 * np.sin(2 * np.pi * t / 4))
    cycle = slice(4000, 8000)
    put_in = np.trapezoid(made["drive_torque"][cycle], made["drive_angle"][cycle])
    taken = np.trapezoid(made["output_torque"][cycle], made["output_angle"][cycle])
    assert put_in > taken >= -1e-6
    after = (t > 5.0) & (t < 5.15)  # the drive turns at 5 s, at its largest angle
    drive, output = np.ptp(made["drive_angle"][after]), np.ptp(made["output_angle"][after])
    assert output < 0.3 * drive * 7 / 5  # delay and transition: Fig. 6


def test_circuit_stands_under_its_pretension_whatever_the_pulley_is():
    """An eccentric pulley is mounted as it is: before the first motion it pulls at neither cable."""
    still = np.full(200, 0.4)
    round_off = {"position_ripple.amplitude": 3e-3, "position_ripple.phase": 0.9, "contact_stiffness": 0.0}
    made = pulley_circuit.simulate(round_off, still)
    assert made["drive_torque"] == pytest.approx(0.0, abs=1e-9)
    assert made["output_angle"][0] * 5 / 7 - 0.4 == pytest.approx(3e-3 * np.sin(8.0 * 0.4 + 0.9), rel=1e-6)


def test_a_hardening_cable_loses_its_tension_as_it_slackens():
    hardening = find("pulley_circuit", "stiffness_hardening")
    largest = hardening.largest * hardening.sized["stiffness_hardening.coefficient"]
    for seed in range(50):
        rig = random_rig("pulley_circuit", np.random.default_rng(seed), (hardening,))
        stiffness, pretension = rig.values["tensile_stiffness"], rig.values["pretension_top"]
        assert largest < stiffness / (4.0 * pretension)


def test_circuit_lost_motion_grows_by_the_gap():
    t = np.arange(0.0, 8.0, CLOCK)
    reference = 0.5 * np.sin(2 * np.pi * t / 4)
    values = {"contact_stiffness": 0.0}
    tight, loose = (pulley_circuit.simulate({**values, "backlash.gap": g}, reference) for g in (0.0, 0.04))
    lost = np.ptp(tight["output_angle"][4000:]) - np.ptp(loose["output_angle"][4000:])
    assert lost == pytest.approx(0.04 * 7 / 5, rel=0.1)  # the coupling's own stiffness gives the rest


@pytest.mark.parametrize("kind", ["white", "ar1", "flicker"])
def test_noise_has_its_size_and_colour(kind):
    rng = np.random.default_rng(3)
    colour = random_colour(kind, rng)
    made = np.array([colour.draw(rng, USUAL, 0.2) for _ in range(60)])
    assert made.std(axis=1).mean() == pytest.approx(0.2, rel=0.03)
    window = np.hanning(USUAL)  # else waves slower than the record leak into all others
    power = (np.abs(np.fft.rfft(made * window)) ** 2).mean(axis=0) / np.sum(window**2) / 0.2**2
    f = np.arange(len(power)) / USUAL
    for low, high in ((2, 6), (6, 30), (30, 300), (300, 1300)):
        assert np.mean(power[low:high] / colour.power(f[low:high])) == pytest.approx(1.0, abs=0.15)
    correlation = np.mean(made[:, 1:] * made[:, :-1]) / made.var()
    assert abs(correlation) < 0.02 if kind == "white" else correlation > 0.2


def test_sensor_faults():
    t = np.arange(0.0, 2.0, CLOCK)
    signals = {"a": np.sin(t), "b": t - 1.0}
    assert distort(t, signals, {"bias:a": 0.5})["a"] == pytest.approx(np.sin(t) + 0.5)
    assert distort(t, signals, {"scale:b": 0.1})["b"] == pytest.approx(1.1 * signals["b"])
    assert distort(t, signals, {"rectification:b": 1.0})["b"] == pytest.approx(np.maximum(signals["b"], 0.0))
    assert distort(t, signals, {"delay:b": 0.25})["b"][500:] == pytest.approx(signals["b"][500:] - 0.25)
    assert quantise(np.array([0.26, -0.24]), 0.5) == pytest.approx([0.5, 0.0])
    at = stamps(np.random.default_rng(0), 5.0, 2.0, 0.01, 0.02)
    assert len(at) == 200 and np.all(np.diff(at) > 0.0097) and np.all(np.diff(at) < 0.0103)

"""The virtual jaw: what the drive tells of friction, compliance and object, and the search for breakaway."""

import math

import numpy as np
import pytest

from cable_envs.baselines import make_controller
from cable_envs.baselines.circuit.play import PlayFilter
from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.parts import Hold
from tests.support.baselines_support import DT, FREE, GRASP, REFERENCES, rmse, simulate, sine, step

LOOSE = {"pretension_top": 35.0, "pretension_bottom": 35.0, "tensile_stiffness": 2e4}
"""Another pretension than the 50 N that are told, and another cable."""


def jaw(task, rig, **gains):
    mode = "position" if task == "position" else "torque"
    return make_controller("virtual-jaw", "pulley_circuit", mode, task, rig, DT, **gains)


def test_play_agrees_with_zous_working_lines():
    """Eqs. (44) and (45) at a grasp torque that the lines were not sampled at."""
    model = CircuitModel(GRASP)
    play = PlayFilter(model, GRASP["contact_stiffness"], 5e-3, 1e-3, 1e-3, DT)
    play.begin(0.0, 0.0, 0.0)
    for side, phase in ((1.0, model.ccw), (-1.0, model.cw)):
        angle, torque = play.held_at(0.17, side)
        assert torque == pytest.approx(phase.drive_torque(0.17), rel=1e-9)
        bent = phase.elongation(0.17) - model.middle_elongation(0.0) + 0.17 / GRASP["contact_stiffness"]
        assert angle == pytest.approx(bent / model.ratio, rel=1e-3)  # begins amid the friction at zero torque


def test_hold_tells_compliance_and_breakaway():
    """A line of 0.2 rad/(N m) with noise, then an output that goes along."""
    rng = np.random.default_rng(5)
    hold, torque = Hold(0.3, 5e-3, 1.5e-3), np.linspace(0.0, 0.15, 100)
    for m in torque:
        assert not hold.leaves(0.2 * m + 2e-4 * rng.standard_normal(), m)
    assert hold.compliance == pytest.approx(0.2, rel=0.05)
    assert any(hold.leaves(0.2 * 0.15 + 1e-4 * k, 0.15) for k in range(60))


def test_friction_compliance_and_output_of_another_circuit_are_found():
    """Friction follows the pretension, 0.7; the compliance 16840 / 20000. 5 %: shares of the pulleys bend the lines."""
    true = {**FREE, **LOOSE}
    controller = jaw("position", FREE)
    simulate(controller, REFERENCES["pulley_circuit", "position", "sine"], 12.0, rig=true)
    friction, compliance = (math.exp(v) for v in controller.jaw.state[1:3])
    assert friction == pytest.approx(0.7, rel=0.05)
    assert compliance == pytest.approx(16840.0 / 2e4, rel=0.05)


def test_another_circuit_is_followed_five_times_as_well_as_by_the_feedforward():
    reference = REFERENCES["pulley_circuit", "position", "sine"]
    other = make_controller("feedforward-pid", "pulley_circuit", "position", "position", FREE, DT)
    ours = rmse(simulate(jaw("position", FREE), reference, 12.0, rig={**FREE, **LOOSE}))
    assert ours * 5 < rmse(simulate(other, reference, 12.0, rig={**FREE, **LOOSE}))


def test_search_finds_breakaway_before_the_step():
    """The jaw moves by a few mrad only; then the drive waits at the end of the dead zone, and the step has no gap."""
    controller = jaw("position", FREE)
    series = simulate(controller, step(0.5, 6.0), 8.0, rig={**FREE, **LOOSE})
    assert controller.jaw.moved
    assert 0.0 < np.abs(series["output_angle"][:600]).max() < 0.01
    assert abs(series["error"][-1]) < 5e-3


def test_grasp_torque_is_held_on_an_object_of_another_stiffness():
    """8 mN m of 110, where the feedforward leaves over 20; object 40 % stiffer than told, friction 30 % less."""
    true = {**GRASP, **LOOSE, "contact_stiffness": 1.4 * GRASP["contact_stiffness"]}
    reference = REFERENCES["pulley_circuit", "torque", "sine"]
    other = make_controller("feedforward-pid", "pulley_circuit", "torque", "torque", GRASP, DT)
    assert rmse(simulate(jaw("torque", GRASP), reference, 20.0, rig=true)) < 8.5e-3
    assert rmse(simulate(other, reference, 20.0, rig=true)) > 20e-3


def test_zero_of_the_encoder_does_not_matter():
    """An encoder that is 0.4 rad off: the commands in its angle are off by as much, and nothing else changes."""
    reference = sine(0.8, 0.2, 0.3)
    plain, shifted = jaw("position", FREE), jaw("position", FREE)
    act = shifted.act
    shifted.act = lambda t, y, ref: act(t, {**y, "drive_angle": y["drive_angle"] + 0.4}, ref) - 0.4
    first, second = (simulate(c, reference, 2.0)["u"] for c in (plain, shifted))
    assert second == pytest.approx(first, abs=1e-9)

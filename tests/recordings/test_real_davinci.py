"""The da Vinci jaw: its transmission model against closed forms, what is named, and slices of the real files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import diagnose
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.weights import reweighted_refit, rmse
from cable_envs.diagnosis.model.model import Block
from cable_envs.diagnosis.model.verdict import from_json
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request as Asked
from cable_envs.diagnosis.readers.writer import write_data_set
from cable_envs.diagnosis.real.davinci import ablations, diagnosed, in_units, load, located
from cable_envs.diagnosis.real.davinci_splits import SPLITS, compare
from cable_envs.diagnosis.real.feedforward import command
from cable_envs.diagnosis.real.finding import inside
from cable_envs.diagnosis.search.select import select
from cable_envs.diagnosis.systems import prepare, transmission
from cable_envs.diagnosis.systems.question import Request
from cable_envs.diagnosis.systems.transmission import Run, assemble, driven, nominals_of
from cable_envs.diagnosis.systems.transmission_effects import NULLS, candidates, rig_of
from cable_envs.plants.transmission.plant import PLANT
from cable_envs.sim.rigs import load_rig, rig_from_mapping

JAW = Path(__file__).parents[3] / "shared" / "recordings" / "davinci_tool"
needs_jaw = pytest.mark.skipif(not JAW.is_dir(), reason=f"the published set davinci_tool is not at {JAW}")
PERIOD = 0.02
TIME = np.arange(0.0, 12.0, PERIOD)


def sent(x, torque, **values):
    """(output angle, output torque) [T] of the plant; ``values``: "coulomb_friction.level" and so on, else nulls."""
    column = PLANT.table.pack(values)[:, None]
    way = np.where(np.gradient(x) >= 0.0, 1.0, -1.0)
    run = Run(x, torque, np.gradient(x, PERIOD), way, "all", ())
    return driven(run, column, PERIOD, x, torque)[:, :, 0].T


def contact(torque, exponent, level):
    """The play of one contact, by its two inequalities, sample by sample: M = w e^(-+l) +- c, w below zero."""
    out = [float((torque[0] - level) * np.exp(exponent))]
    for now in torque[1:]:
        opening, closing = (now - level) * np.exp(exponent), (now + level) * np.exp(-exponent)
        out.append(opening if out[-1] < opening else closing if out[-1] > closing else out[-1])
    return np.array(out)


def test_without_effects_the_transmission_is_rigid_and_conserves_power():
    x = 0.5 * np.sin(2.0 * TIME)
    torque = -0.1 + 0.02 * np.cos(3.0 * TIME)
    angle, wrench = sent(x, torque, ratio=0.9)
    np.testing.assert_allclose(angle, 0.9 * x, atol=1e-15)
    np.testing.assert_allclose(torque * np.gradient(x), wrench * np.gradient(angle), atol=1e-15)


def test_a_contact_holds_until_the_band_of_friction_is_crossed():
    torque = -0.15 - 0.1 * np.sin(2.0 * TIME)
    effects = {
        "coulomb_friction.level": 0.02, "load_dependent_friction.exponent": 0.3, "presliding_hysteresis.share": 1.0
    }  # fmt: skip
    _, wrench = sent(TIME, torque, **effects)
    np.testing.assert_allclose(wrench, contact(torque, 0.3, 0.02), rtol=1e-12)
    held = np.diff(wrench) == 0.0
    assert 0.2 < held.mean() < 0.9


def test_friction_by_the_sign_of_motion_has_the_slopes_of_both_directions():
    x = 0.5 * np.sin(TIME)
    effects = {"coulomb_friction.level": 0.02, "load_dependent_friction.exponent": 0.3}
    torques = (-0.1, -0.2)
    low, high = (sent(x, np.full_like(x, m), **effects)[1] for m in torques)
    opening, closing = np.gradient(x) > 0.0, np.gradient(x) < 0.0
    np.testing.assert_allclose((torques[1] - torques[0]) / (high - low)[opening], np.exp(-0.3), rtol=1e-12)
    np.testing.assert_allclose((torques[1] - torques[0]) / (high - low)[closing], np.exp(0.3), rtol=1e-12)


def test_the_springs_stiffen_as_the_cable_effect_has_it():
    """T = k e (1 + h k e / 2) of stiffness_hardening, solved for the stretch e."""
    torque = np.linspace(-0.3, 0.3, len(TIME))
    soft, hard = 1.5, 12.0
    names = {"cable_elongation.drive_side": soft, "stiffness_hardening.drive_side": hard}
    stretch = -sent(np.zeros_like(TIME), torque, **names)[0]
    linear = np.abs(stretch) / soft
    np.testing.assert_allclose(linear * (1.0 + 0.5 * hard * linear), np.abs(torque), atol=1e-12)
    assert np.all(np.sign(stretch) == np.sign(torque))


def test_a_delay_is_one_between_samples_too():
    x = 0.5 * np.sin(2.0 * TIME)
    late = sent(x, np.zeros_like(x), **{"sensor_delay.output_angle": 2.5 * PERIOD})[0]
    np.testing.assert_allclose(late[3:], 0.5 * (x[1:-2] + x[:-3]), atol=1e-12)


def made(load, rate, name, spring=False, **values):
    """A run that follows the kernel, with slow errors of both sensors; ``spring``: closing winds up the load."""
    x = 0.5 * np.sin(2 * np.pi * rate * TIME)
    wish = -load * (1.0 - 0.4 * x if spring else 1.0 + 0.1 * np.cos(2 * np.pi * rate * TIME))
    way = np.where(np.gradient(x) >= 0.0, 1.0, -1.0)
    torque = wish * np.exp(-0.35 * way) + 0.03 * way
    torque = np.convolve(np.pad(torque, 5, mode="edge"), np.ones(11) / 11, "valid")
    angle, wrench = sent(x, torque, **values)
    rng = np.random.default_rng(int(1e3 * load + 10 * rate))
    drift = [np.convolve(rng.normal(size=len(x) + 49), np.ones(50) / 50, "valid") for _ in range(2)]
    good = (TIME > 1.0) & (TIME < 11.0)
    speed = np.gradient(x, PERIOD)
    along = tuple(transmission.motion_coordinates(TIME, x, "rad"))
    blocks = (
        Block(name, "output_angle", TIME, angle + 3e-3 * drift[0], good, "rad", along),
        Block(name, "output_torque", TIME, wrench + 1e-3 * drift[1], good, "N m", along),
    )
    return Run(x, torque, speed, way, "all", blocks)


TRUTH = {
    "ratio": 0.9, "coulomb_friction.level": 0.03, "load_dependent_friction.exponent": 0.35,
    "presliding_hysteresis.share": 1.0, "cable_elongation.output_side": 1.2,
}  # fmt: skip


def some(*names):
    return [h for h in candidates().asked if h.name in names]


def _of_four(loads):
    """Records of two loads and two rates to fit; held out: ``loads`` between them, at another rate."""
    fit = [made(load, rate, f"{load}-{rate}", spring=True, **TRUTH) for load in (0.04, 0.12) for rate in (0.2, 0.5)]
    unseen = [made(load, 0.4, f"held {load}", spring=True, **TRUTH) for load in loads]
    fit, heldout = assemble(fit, unseen, PERIOD)
    there = {n.split(".")[0] for n in TRUTH if "." in n}
    rivals = some(*there, "viscous_friction", "backlash", "friction_drift")
    return fit, there, select(fit, heldout, nominals_of(fit.parameters), rivals, np.random.default_rng(0))


def test_what_one_held_out_record_does_not_tell_apart_is_unknown():
    _, _, selection = _of_four((0.08,))
    assert selection.verdict == "unknown"


def test_the_selection_names_what_was_put_in_and_nothing_else():
    fit, there, selection = _of_four((0.05, 0.08, 0.11))
    steps, found = selection.steps, selection.final.fit
    assert set(inside(steps)) == there
    assert found.values["load_dependent_friction.exponent"] == pytest.approx(0.35, abs=0.01)
    assert found.values["coulomb_friction.level"] == pytest.approx(0.03, abs=1e-3)
    soft = found.values["cable_elongation.drive_side"] + found.values["cable_elongation.output_side"]
    assert soft == pytest.approx(1.2, rel=0.03)
    first, last = (in_units(r.heldout) for r in (steps[0], steps[-1]))
    assert last["deg"] < 0.1 * first["deg"] and last["mnm"] < 0.01 * first["mnm"]
    # at first what is left follows direction or load
    assert max(located(fit, selection.null.fit.values)["output_torque"].values()) > 0.5


def test_of_two_springs_that_are_one_without_friction_either_is_named():
    """Behind the contacts or before: a rigid contact hands the torque through, and nothing tells them apart."""
    truth = {"ratio": 0.9, "cable_elongation.output_side": 1.2}
    fit = [made(load, 0.4, str(load), spring=True, **truth) for load in (0.04, 0.12)]
    fit, heldout = assemble(fit, [made(0.08, 0.3, "held", spring=True, **truth)], PERIOD)
    rivals = some("partial_slip", "cable_elongation", "backlash")
    found = select(fit, heldout, nominals_of(fit.parameters), rivals, np.random.default_rng(0))
    (spring,) = found.accepted
    assert {spring.hypothesis.name, *spring.alternatives} == {"cable_elongation", "partial_slip"}


def test_a_rigid_transmission_gets_no_effect():
    fit = [made(load, 0.4, str(load), ratio=0.9) for load in (0.04, 0.12)]
    fit, heldout = assemble(fit, [made(0.08, 0.3, "held", ratio=0.9)], PERIOD)
    rivals = some("coulomb_friction", "cable_elongation", "backlash", "viscous_friction")
    assert select(fit, heldout, nominals_of(fit.parameters), rivals, np.random.default_rng(0)).accepted == ()


def test_feedforward_undoes_the_transmission():
    """Where the jaw moves and friction is turned round, the command is the drive angle that was there."""
    values = {**NULLS, **TRUTH, "zero.all": 0.0, "torque_zero": 0.0}
    run = made(0.12, 0.2, "made", spring=True, **TRUTH)
    angle, wrench = sent(run.x, run.torque, **TRUTH)
    x, torque = command(run, values, angle, wrench)
    since, _ = transmission.since_reversal(run.x)
    turned = (since > 0.2) & (TIME > 2.0) & (np.abs(run.x) < 0.45)  # the made torque turns a little before the drive
    np.testing.assert_allclose(x[turned], run.x[turned], atol=1e-6)
    np.testing.assert_allclose(torque[turned], run.torque[turned], atol=1e-6)


def test_feedforward_takes_a_gap_up_in_the_direction_of_motion_and_not_for_the_noise_of_the_wish():
    gap, ratio = 0.03, 0.9
    run = made(0.12, 0.2, "made", ratio=ratio)
    wish = ratio * run.x + 2e-4 * np.random.default_rng(0).standard_normal(len(TIME))
    values = {**NULLS, "ratio": ratio, "backlash.gap": gap, "zero.all": 0.0, "torque_zero": 0.0}
    x, _ = command(run, values, wish, run.torque / ratio)
    ahead = ratio * x - wish
    np.testing.assert_allclose(np.abs(ahead), 0.5 * gap, atol=1e-9)
    moving = np.abs(np.gradient(run.x, PERIOD)) > 0.2 * np.abs(np.gradient(run.x, PERIOD)).max()
    np.testing.assert_array_equal(np.sign(ahead[moving]), np.sign(np.gradient(run.x, PERIOD)[moving]))


def test_hypotheses_of_the_command_line():
    assert [h.name for h in candidates(Request(only=("backlash",))).asked] == ["backlash"]
    assert "sensor_scale.output_torque" not in [h.name for h in candidates(Request(without=("sensor_scale",))).asked]
    with pytest.raises(ConfigurationError, match="backlash"):
        candidates(Request(only=("backlsh",)))


def test_the_rig_found_has_what_was_fitted_and_nothing_else():
    values = {**NULLS, **TRUTH, "zero.all": -0.1}
    rig = load_rig(rig_from_mapping(rig_of(values)))
    assert rig.plant == "transmission" and rig.values["ratio"] == 0.9
    fitted = {name: value for name, value in TRUTH.items() if "." in name}
    assert {name: v for name, v in rig.effects.items() if v != 0.0} == {**fitted, "sensor_bias.output_angle": -0.1}


def test_a_zero_of_each_group_is_named_and_not_written():
    rig = rig_of({**NULLS, "zero.first": -0.1, "zero.second": 0.2})
    assert "sensor_bias" not in rig.get("effects", {})
    assert "first -0.1" in rig["description"] and "second 0.2" in rig["description"]


@pytest.fixture(scope="module")
def jaw(tmp_path_factory):
    """Five loads at 0.5 Hz of the real set; held out: two loads."""
    if not JAW.is_dir():
        pytest.skip(f"the published set davinci_tool is not at {JAW}")
    data = reader("da-vinci-jaw").open_dataset(JAW, Asked(None, True))
    out = tmp_path_factory.mktemp("jaw")
    return load_recording(write_data_set(data, out, chosen=["Tool_4_Maryland_L_4_4?"]).path)


@needs_jaw
def test_the_jaw_asks_for_the_transmission_and_nothing_else(jaw):
    question = prepare(jaw)
    assert question.nominals == ("ratio", "torque_zero", "zero.Tool_4_Maryland_L_4")
    assert len(question.fit.blocks) == 6 and len(question.heldout.blocks) == 4
    without = replace(jaw, channels={k: v for k, v in jaw.channels.items() if k != "output_torque"})
    assert not transmission.fits(without)


@needs_jaw
def test_friction_alone_explains_most_of_the_jaws_torque(jaw):
    """Friction of both kinds that sticks: from 70 mN m to less than 5, on loads that no refit saw."""
    fit, heldout = transmission.models(jaw)
    friction = ("coulomb_friction.level", "load_dependent_friction.exponent", "presliding_hysteresis.share")
    soft = ("cable_elongation.drive_side", "cable_elongation.output_side")
    wiring = ("position_dependent_load.drive_side", "position_dependent_load.output_side")
    nominals = nominals_of(fit.parameters)
    errors = []
    for free in ((), friction, (*friction, *soft), (*friction, *soft, *wiring)):
        begin = {"coulomb_friction.level": 0.04, "load_dependent_friction.exponent": 0.4} if free else {}
        one = reweighted_refit(
            fit, Start("", (*nominals, *free), begin | ({"presliding_hysteresis.share": 1.0} if free else {}))
        )
        errors.append(in_units(rmse(heldout, one[0])))
    rigid, stuck, soft_too, whole = errors
    assert rigid["mnm"] > 60 and stuck["mnm"] < 0.15 * rigid["mnm"]
    assert soft_too["deg"] < 0.6 and soft_too["deg"] < 0.4 * rigid["deg"]
    assert whole["mnm"] < 0.65 * soft_too["mnm"]
    # the lines across loads, at the middle of the travel, say 0.38 (test_real_recordings). Springs that pull back at
    # the ends of the travel go with the direction of motion as friction does: without them in the model it is 0.50
    assert one[0].values["load_dependent_friction.exponent"] == pytest.approx(0.40, abs=0.06)


@pytest.mark.slow
@needs_jaw
def test_a_rig_that_noise_does_not_limit_is_answered_with_what_is_left(jaw):
    wanted = ["coulomb_friction", "cable_elongation", "presliding_hysteresis", "load_dependent_friction"]
    found = diagnose(jaw, effects=wanted)
    assert found.steps[0].name == ""
    for channel in ("output_angle", "output_torque"):
        errors = found.fit[channel]["heldout_rmse"]
        assert errors["augmented"] < 0.5 * errors["refit"]
        assert errors["augmented"] == pytest.approx(found.steps[-1].heldout[channel])
    assert found.test["log_odds_left"] > found.test["sure"]  # no law of friction is right to the sensors' noise
    assert from_json(json.loads(json.dumps(found.as_json()))).as_json() == found.as_json()


@needs_jaw
@pytest.mark.slow
def test_effects_taken_out_of_the_real_jaw_are_found_again(tmp_path):
    """Friction that grows with the load is not yet: a torque sensor's scale of 0.73 takes its place, else 0.93.

    The full model is better than that by log odds of 180, but in another valley than a refit from there ends in.
    Nor is the spring, of which its hardening goes, too: one effect is asked for, and a spring that does not harden
    leaves less of the angle and more of the torque (weighted squares of 25 and 23 for 27 and 21; log odds of -20).
    """
    data = reader("da-vinci-jaw").open_dataset(JAW, Asked(None, True))
    write_data_set(data, tmp_path / "series", chosen=["Tool_4_Maryland_L_4_??"])
    whole = diagnosed(load(tmp_path / "series"))
    there = inside(whole.diagnosis.steps)
    assert {"stribeck_friction", "load_dependent_friction", "presliding_hysteresis", "cable_elongation"} <= set(there)
    rows = ablations(whole)
    assert len(rows) >= 4
    lacking = {row["removed"]: row["found"] for row in rows if not row["in_class"]}
    if lacking == {"load_dependent_friction": "", "cable_elongation": ""}:
        pytest.xfail("a torque sensor's scale takes the place of friction; a spring is told with its hardening only")
    assert lacking == {}


@needs_jaw
@pytest.mark.slow
def test_physics_beats_the_neighbours_on_loads_never_seen(jaw):
    fit, _ = transmission.models(jaw)
    free = (
        "coulomb_friction.level", "load_dependent_friction.exponent", "presliding_hysteresis.share",
        "cable_elongation.drive_side", "cable_elongation.output_side", "position_dependent_load.drive_side",
    )  # fmt: skip
    begin = {p.name: p.start for p in fit.parameters} | {
        "coulomb_friction.level": 0.04, "load_dependent_friction.exponent": 0.4, "presliding_hysteresis.share": 1.0,
    }  # fmt: skip
    alternate = next(s for s in SPLITS if s.name == "alternate loads held out, closing")
    rows = {row["model"]: row for row in compare(jaw, free, begin, splits=[alternate])}
    assert rows["physics"]["mnm"] < 0.5 * rows["neighbours"]["mnm"]
    # neighbours of loads that were seen are worse than a straight line on others
    assert rows["physics"]["deg"] < 0.5 * rows["rigid"]["deg"] < 0.5 * rows["neighbours"]["deg"]

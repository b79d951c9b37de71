"""`cablebench diagnose` from a recording's folder to its files, on a drive that this test integrates by itself."""

import json
from html.parser import HTMLParser

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import asked, engine
from cable_envs.diagnosis.asked import kept_back
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit import locate
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.intake.standing import stuck
from cable_envs.diagnosis.model.model import Coordinate
from cable_envs.diagnosis.model.verdict import from_json
from cable_envs.diagnosis.search import stages
from cable_envs.diagnosis.systems.question import Question
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from cablebench.cli.app import app
from cablebench.pages.diagnosis_words import advice, cost, headline, lines
from tests.support import drive_recording as drive

LOOK_FOR = "position_dependent_load,actuator_lag"
STIFFNESS = 60.0


def spring(y, v, t):
    return STIFFNESS * y


@pytest.fixture(scope="module")
def sprung(tmp_path_factory):
    """(recording of a drive with a spring that nobody mentions, folder of its diagnosis, the command's result)."""
    place = tmp_path_factory.mktemp("sprung")
    recording, out = drive.write(place / "recording", spring), place / "out"
    words = ["diagnose", str(recording), "--out", str(out), "--json", "--effects", LOOK_FOR]
    return recording, out, CliRunner().invoke(app, words, catch_exceptions=False)


def test_a_hidden_spring_is_named_sized_and_located(sprung):
    _, out, done = sprung
    assert done.exit_code == 0
    record = json.loads(done.stdout)
    assert record == json.loads((out / "diagnosis.json").read_text())
    assert (record["schema"], record["verdict"]) == ("cable-diagnosis/1", "named")
    (effect,) = record["effects"]
    assert effect["name"] == "position_dependent_load" and effect["confidence"] > 0.7
    low, high = effect["parameters"]["stiffness"]["ci95"]
    assert low < STIFFNESS < high
    assert high - low < 0.25 * STIFFNESS  # 1.96 x 4 % either way is for the formulation (`confidence.FORM`)
    for fit in record["fit"].values():
        assert fit["heldout_rmse"]["augmented"] < 1.15 * fit["noise_floor"]
    assert record["fit"]["force"]["heldout_rmse"]["refit"] > 1.3 * record["fit"]["force"]["noise_floor"]
    inside = [b - a for a, b in record["location"][0]["intervals_s"]]
    assert 0.0 < sum(inside) <= 8.0 and record["location"][0]["share_of_excess"] >= 0.9
    assert abs(record["absorbed"]["mass"]["after_model"] - drive.MASS) < 0.05


def test_nothing_is_written_outside_the_folder_asked_for(sprung):
    recording, out, _ = sprung
    assert {f.name for f in out.iterdir()} == {"diagnosis.json", "augmented.yaml", "report.html"}
    assert {f.name for f in recording.iterdir()} == {"recording.yaml", "run_1.csv", "run_2.csv", "run_3.csv"}
    assert {f.name for f in recording.parent.iterdir()} == {"recording", "out"}


def test_the_augmented_rig_leaves_nothing_to_find(sprung):
    recording, out, _ = sprung
    rig = load_rig(out / "augmented.yaml")
    assert rig.plant == "linear_drive"
    again = diagnose(recording, rig=out / "augmented.yaml", effects=["actuator_lag", "sensor_scale"])
    assert again.verdict == "no_detectable_mismatch" and not again.location


def test_what_a_given_rig_leaves_without_its_effects_is_what_the_refit_left(sprung):
    folder, out, done = sprung
    recording = load_recording(folder)
    corrected = asked.request_of(recording, rig=out / "augmented.yaml")
    question = asked.ask(recording, corrected)
    plain = engine.without_its_effects(recording, corrected)
    with_it = Joint(question.fit, question.heldout).left_by(refit_nominals(question.fit, question.nominals).fit)
    errors = json.loads(done.stdout)["fit"]
    for channel, left in plain.items():
        assert left > with_it[channel]
        both = [errors[channel][use]["refit"] for use in ("fit_rmse", "heldout_rmse")]
        assert min(both) < left < max(both)
    assert engine.without_its_effects(recording, asked.request_of(recording)) is None


OWN = """
from cable_envs.effects import Effect, EffectParameter

def spring(position, velocity, tension, stiffness):
    return SIGN * stiffness * position**3

EFFECT = Effect(
    name="cubic_spring", seam="load", equation="F = -stiffness y^3", source="a test", validity="any travel",
    experiment="hold at eight positions", plants=("linear_drive",), hooks={"load": spring},
    parameters=(EffectParameter("stiffness", "N/m^3", 0.0, 0.0, 1e8, "spring to ground", typical=5e3),),
)
"""


@pytest.mark.slow
def test_an_effect_of_ones_own_is_named_and_its_rig_leaves_nothing_to_find(tmp_path):
    recording = drive.write(tmp_path / "recording", lambda y, v, t: 8e3 * y**3)
    for name, sign in (("right.py", "1.0"), ("wrong.py", "-1.0")):
        (tmp_path / name).write_text(OWN.replace("SIGN", sign))
    words = ["diagnose", str(recording), "--json", "--effects", "cubic_spring,actuator_lag"]
    own, out = ["--effect-file", str(tmp_path / "right.py")], tmp_path / "out"
    record = json.loads(CliRunner().invoke(app, [*words, *own, "--out", str(out)], catch_exceptions=False).stdout)
    (effect,) = record["effects"]
    low, high = effect["parameters"]["stiffness"]["ci95"]
    assert effect["name"] == "cubic_spring" and low < 8e3 < high < 1.5 * 8e3
    rig = ["--rig", str(out / "augmented.yaml"), "--out", str(tmp_path / "again")]
    again = CliRunner().invoke(app, [*words, *own, *rig], catch_exceptions=False)
    assert json.loads(again.stdout)["verdict"] == "no_detectable_mismatch"
    turned = ["--effect-file", str(tmp_path / "wrong.py"), "--out", str(tmp_path / "turned")]
    record = json.loads(CliRunner().invoke(app, [*words, *turned], catch_exceptions=False).stdout)
    state = next(h["state"] for h in record["hypotheses"] if h["name"] == "cubic_spring")
    assert record["verdict"] == "unknown" and state.endswith("the data ask for the other sign, which it cannot have")


def test_the_report_is_one_file_that_speaks_of_the_spring(sprung):
    class Reader(HTMLParser):
        links, text = [], ""

        def handle_starttag(self, tag, attributes):
            self.links += [v for k, v in attributes if k in ("src", "href") and not v.startswith("#")]

        def handle_data(self, data):
            self.text += data

    reader = Reader()
    reader.feed((sprung[1] / "report.html").read_text())
    assert reader.links == []
    assert "The simulator lacks position-dependent load" in reader.text
    assert "actuator lag" in reader.text and "recorded less" in reader.text


def test_a_verdict_comes_back_from_its_json(sprung):
    record = json.loads((sprung[1] / "diagnosis.json").read_text())
    assert from_json(record).as_json() == record
    with pytest.raises(ConfigurationError, match="cable-diagnosis/1"):
        from_json({**record, "schema": "other"})


def test_nothing_missing_is_answered_so_with_the_sizes_that_would_show(tmp_path):
    recording = drive.write(tmp_path / "recording")
    found = diagnose(recording, effects=LOOK_FOR.split(","))
    assert found.verdict == "no_detectable_mismatch" and found.effects == ()
    size = found.test["minimum_detectable"]["position_dependent_load"]
    assert size.endswith(" N/m") and 0.01 < float(size.split()[0]) < STIFFNESS


@pytest.mark.slow
def test_an_interrupted_diagnosis_goes_on_where_it_was(tmp_path, monkeypatch):
    recording, out = drive.write(tmp_path / "recording", spring), tmp_path / "out"

    def stop(text):
        if text == stages.COMPARING:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(recording, effects=["position_dependent_load"], out=out, tell=stop)
    assert len(list(out.rglob("*.pickle"))) == 2
    whole = diagnose(recording, effects=["position_dependent_load"])
    monkeypatch.setattr(
        "cable_envs.diagnosis.search.effects.refit_nominals", lambda *a: pytest.fail("a finished step was repeated")
    )
    resumed = diagnose(recording, effects=["position_dependent_load"], out=out)
    assert {**resumed.as_json(), "about": None} == {**whole.as_json(), "about": None}
    assert not list(out.rglob("*.pickle"))


def test_ctrl_c_ends_the_command_with_130(sprung, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, "diagnose", interrupted)
    done = CliRunner().invoke(app, ["diagnose", str(sprung[0]), "--out", str(tmp_path / "out")])
    assert done.exit_code == 130 and "goes on from there" in done.stderr


def _with(rows, column, value):
    def change(k, table):
        if k == 0:
            table[rows, column] = value
        return table

    return change


def _scaled(column, factor):
    def change(k, table):
        table[:, column] *= factor
        return table

    return change


def _gap(k, table):
    return np.delete(table, slice(300, 350), axis=0) if k == 0 else table


FAULTS = {
    "gap": (_gap, r"run_1.csv, channel time, row 301: a gap of 0.51 s"),
    "dead": (_with(slice(None), 3, 0.25), r"run_1.csv, channel velocity, row 1: constant at 0.25"),
    "stuck": (_with(slice(200, 260), 2, 0.0123), r"run_1.csv, channel position, row 201: .* stuck"),
    "outlier": (_with(400, 4, 900.0), r"run_1.csv, channel force, row 401: a jump by"),
    "empty": (_with(slice(100, 700), 3, np.nan), r"run_1.csv, channel velocity, row 101: 75% of the samples"),
    "mm": (_scaled(2, 1e3), r"run_1.csv, channel position, row 1: .*'mm' would fit"),
    "mN": (_scaled(4, 1e3), r"run_1.csv, channel force, row 1: .*'mN' would fit"),
    "mm/s": (_scaled(3, 1e3), r"run_1.csv, channel velocity, row 1: .*'mm/s' would fit"),
    "ms": (_scaled(0, 1e3), r"run_1.csv, channel time, row 1: a sample every 10 s; .*'ms' would fit"),
    "shuffled": (_with(50, 0, 0.1), r"run_1.csv, channel time .* row 51: time must increase"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_data_is_named_by_record_channel_and_row(tmp_path, fault):
    change, message = FAULTS[fault]
    recording = drive.write(tmp_path / "recording", change=change)
    with pytest.raises(ConfigurationError, match=message):
        diagnose(recording)


def test_saturation_is_a_fault_and_no_friction(tmp_path):
    def clipped(k, table):
        table[:, 4] = np.clip(table[:, 4], -1.5, 1.5)
        return table

    with pytest.raises(ConfigurationError, match=r"channel force, row \d+: .* highest value 1.5: saturated"):
        diagnose(drive.write(tmp_path / "recording", change=clipped))


def test_a_channel_that_is_mostly_at_its_limits_is_saturated_and_one_that_rests_there_is_not():
    """With most samples on two levels third differences say nothing of the noise; an encoder may rest on two counts."""
    t = 0.01 * np.arange(3000)
    wave = 3.0 * np.sin(2.0 * np.pi * 0.3 * t)
    noisy = wave + 0.01 * np.random.default_rng(0).normal(size=len(t))
    square = np.tanh(4.0 * np.sin(2.0 * np.pi * 0.3 * t))

    def said(values):
        return [str(fault) for fault in stuck("run", "angle", values, np.ones(len(t), dtype=bool))]

    for clipped, level in ((np.clip(noisy, -1.0, 1.0), "1"), (np.minimum(noisy, -1.5), "-1.5")):
        (fault,) = said(clipped)
        assert f"in a row at its highest value {level}: saturated" in fault
    for count in (1e-6, 1e-3, 0.05):
        assert not said(count * np.round(np.clip(wave, -1.0, 1.0) / count))
        assert not said(count * np.round(square / count))


def test_single_empty_cells_are_left_out_and_noted(tmp_path):
    quality = gate(load_recording(drive.write(tmp_path / "recording", change=_with(slice(100, 103), 3, np.nan))))
    assert quality.notes == (
        "run_1.csv, channel velocity, row 101: 3 samples that are empty or marked in doubt are left out",
    )
    assert quality.visited["motion"] == "position" and quality.visited["reversals"] > 5


def test_rows_that_stand_twice_are_left_out_and_noted(tmp_path):
    def twice(k, table):
        return table[[0, 0, *range(1, len(table)), -1]] if k == 0 else table

    notes = gate(load_recording(drive.write(tmp_path / "recording", change=twice))).notes
    text = "rows that repeat the one before are left out (2); row numbers leave them out"
    assert notes == (f"run_1.csv, channel time, row 2: {text}",)


def test_too_many_samples_are_refused_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr("cable_envs.diagnosis.intake.gate.MOST", 2000)
    with pytest.raises(ConfigurationError, match=r"run_3.csv, channel time, row 800: 2400 rows make 2400 samples"):
        diagnose(drive.write(tmp_path / "recording"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effects": ["backlsh"]}, "did you mean 'backlash'"),
        ({"without": ["coulomb"]}, "did you mean 'coulomb_friction'"),
        ({"effects": ["backlash"], "without": ["backlash"]}, "no effect is left"),
        ({"effect_file": "absent.py"}, "no such file"),
        ({"rig": "gu-inferred"}, "belongs to cable_hole"),
        ({"variant": "chains"}, "did you mean 'chain'"),
        ({"variant": "chain"}, "this recording has one"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(tmp_path, options, message):
    with pytest.raises(ConfigurationError, match=message):
        diagnose(drive.write(tmp_path / "recording"), **options)


def _closed_form(folder, delay):
    """A recording of the circuit's closed form, whose output sensor is late by ``delay`` s."""
    rig = load_rig("zou-table2")
    plant = rig.simulated_by("analytic")
    values = rig.column(plant)
    values[plant.table.index("sensor_delay.output_angle")] = delay
    rng, time, entries = np.random.default_rng(3), 0.01 * np.arange(1, 901), []
    folder.mkdir()
    for k, turn in enumerate((1.3, 2.1, 1.7), 1):
        command = 0.5 * np.sin(turn * time) + 0.2 * np.sin(2.7 * turn * time)
        names = {"drive_angle": 2e-4, "output_angle": 2e-4, "drive_torque": 2e-3, "output_torque": 1e-3}
        seen = replay(plant, values, command, 0.01, drive="position", signals=list(names), substeps=10)[:, :, 0]
        noisy = seen + np.array(list(names.values())) * rng.standard_normal(seen.shape)
        header = ",".join(["t", "drive_angle_command", *names])
        np.savetxt(
            folder / f"run_{k}.csv", np.column_stack([time, command, noisy]), delimiter=",", header=header, comments=""
        )
        entries.append({"data": f"run_{k}.csv", "use": "heldout" if k == 3 else "fit"})
    units = {"drive_angle_command": "rad", "drive_angle": "rad", "output_angle": "rad"}
    channels = {"time": {"column": "t", "unit": "s"}, "drive_angle_command": {"unit": "rad"}} | {
        name: {"unit": units.get(name, "N m"), "noise_std": std} for name, std in names.items()
    }
    content = {
        "schema": "cable-recording/1", "system": "pulley_circuit", "rig": "zou-table2", "records": entries,
        "channels": {name: {"column": name, **channel} for name, channel in channels.items()},
    }  # fmt: skip
    (folder / "recording.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_the_closed_form_of_a_circuit_is_asked_for_by_name(tmp_path):
    recording = _closed_form(tmp_path / "recording", 0.01)
    words = ["diagnose", str(recording), "--json", "--variant", "analytic"]
    words += ["--effects", "sensor_delay,actuator_lag,sensor_bias"]
    found = json.loads(CliRunner().invoke(app, words, catch_exceptions=False).stdout)
    assert found["verdict"] == "named" and found["about"]["variant"] == "analytic"
    (effect,) = found["effects"]
    (parameter,) = effect["parameters"].values()
    assert effect["hypothesis"] == "sensor_delay.output_angle"
    assert parameter["ci95"][0] < 0.01 < parameter["ci95"][1]
    over = {name: fit["heldout_rmse"]["augmented"] / fit["noise_floor"] for name, fit in found["fit"].items()}
    assert max(over.values()) < 1.1
    chain = asked.ask(load_recording(recording), asked.request_of(load_recording(recording), ["sensor_bias"]))
    assert chain.fit.plant.name == "pulley_chain"


def _played(folder, env, options, controller):
    words = ["export", env, "--out", str(folder), "--format", "recording", "--controller", controller]
    words += ["--episodes", "3", "-o", "sensor_noise=true", "-o", "duration=10"]
    for option in options:
        words += ["-o", option]
    assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0
    return folder


def test_a_simulators_own_episodes_are_replayed_as_they_were_held(tmp_path):
    """Held commands, a controller that feels its sensors' noise: nothing is missing, not even a fraction of a step."""
    options = ["action_mode=speed"]
    recording = load_recording(_played(tmp_path / "hole", "CableHole-Position-Sine", options, "oracle"))
    assert recording.channels["drive_velocity_command"].hold == "step"
    found = diagnose(recording, effects=["sensor_delay", "actuator_lag", "viscoelastic_creep"])
    assert found.verdict == "no_detectable_mismatch"


@pytest.mark.slow
def test_an_effect_of_the_environment_is_found_in_its_episodes(tmp_path):
    options = ["effects={actuator_lag: {time: 0.01}}"]
    folder = _played(tmp_path / "circuit", "PulleyCircuit-Position-Sine", options, "feedforward-pid-tuned")
    recording = load_recording(folder)
    assert "actuator_lag.time = 0.01" in recording.description  # told to people; the rig's entry does not have it
    found = diagnose(recording, effects=["sensor_delay", "actuator_lag", "cable_elongation"])
    (effect,) = found.effects
    assert (found.verdict, effect.name) == ("named", "actuator_lag")
    time = effect.parameters["time"]
    assert time.low < 0.01 < time.high < 0.012


def test_without_heldout_records_the_last_third_of_each_is_kept_back(tmp_path):
    recording = load_recording(drive.write(tmp_path / "recording", uses=("fit", "fit")))
    cut, ends = kept_back(recording)
    assert [len(r.time) for r in cut.used_for("fit")] == [533, 533]
    question = asked.ask(recording, asked.request_of(recording, ["actuator_lag"]))
    assert {b.record for b in question.heldout.blocks} == {"run_1.csv", "run_2.csv"}
    for block in question.heldout.blocks:
        assert not block.good[block.time < ends[block.record]].any() and block.good[block.time > 5.4].all()
    for block in question.fit.blocks:
        assert block.time[-1] < ends[block.record]


def test_the_regime_is_where_the_energy_is():
    t = np.arange(0.0, 20.0, 0.01)
    position = np.sin(t)
    speed = Coordinate("speed", "m/s", np.cos(t))
    along = [Coordinate("position", "m", position), speed]
    found = locate.regime(along, np.where(speed.values > 0.5, 1.0, 0.001))
    assert found.coordinate == "speed" and 0.3 < found.low < 0.6 and found.energy >= 0.8
    text = locate.words(found, Question.ways, {c.name: c for c in along})
    assert text.startswith("moving forward, above")
    assert locate.regime(along, np.ones(len(t))) is None
    spans, held = locate.intervals(t, np.where((t > 5.0) & (t < 6.0), 1.0, 0.0))
    assert spans == [[5.0, 6.0]] and held == 1.0


def _rubbing(folder):
    """Position and force of a 2 kg mass on which 3 N of friction is most of the effort."""
    folder.mkdir()
    t, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(0)
    records = []
    for k, (rate, use) in enumerate(((1.0, "fit"), (1.7, "fit"), (1.3, "heldout"))):
        x = 0.03 * np.sin(rate * t)
        force = -2.0 * rate**2 * x + 3.0 * np.sign(np.cos(rate * t))
        noisy = [x + rng.normal(0.0, 1e-5, len(t)), force + rng.normal(0.0, 0.1, len(t))]
        np.savetxt(folder / f"run_{k}.csv", np.column_stack([t, *noisy]), delimiter=",", header="t,x,F", comments="")
        records.append({"data": f"run_{k}.csv", "use": use})
    channels = {"time": ("t", "s"), "position": ("x", "m"), "force": ("F", "N")}
    content = {
        "schema": "cable-recording/1", "system": "linear_drive", "records": records,
        "channels": {name: {"column": column, "unit": unit} for name, (column, unit) in channels.items()},
    }  # fmt: skip
    (folder / "recording.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_an_observed_drive_needs_no_mass_where_its_force_was_recorded(tmp_path):
    """Friction is most of the force; of a voltage, which may be any force, the mass must be stated."""
    folder = _rubbing(tmp_path / "rubbing")
    content = yaml.safe_load((folder / "recording.yaml").read_text())
    for stated in ({}, {"mass": {"value": 2.1, "std": 0.1, "unit": "kg"}}, {"mass": {"value": 2.1, "unit": "kg"}}):
        (folder / "recording.yaml").write_text(yaml.safe_dump({**content, "nominal": stated} if stated else content))
        found = diagnose(folder, effects=["coulomb_friction", "position_dependent_load", "backlash"])
        assert [e.name for e in found.effects] == ["coulomb_friction"]
        assert found.effects[0].parameters["level"].value == pytest.approx(3.0, rel=0.05)
    content["channels"]["voltage"] = {**content["channels"].pop("force"), "unit": "V"}
    (folder / "recording.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(
        ConfigurationError, match=r"neither stated nor told by the records: .* nominal: \{mass: \{value: 2.5"
    ):
        diagnose(folder)


def test_an_effect_that_costs_little_is_said_to():
    fit = {"unit": "m", "noise_floor": 6.4e-6, "heldout_rmse": {"nominal": 5e-5, "refit": 6.6e-6, "augmented": 6.55e-6}}
    record = {"verdict": "named", "fit": {"load_position": fit}}
    assert cost(record).startswith("It changes little: on held-out records the error of load position")
    fit["heldout_rmse"]["refit"] = 9e-6
    assert cost(record).startswith(
        "On held-out records the error of load position is 0.009 mm RMS without it and 0.00655 mm with it"
    )


def test_an_unknown_mismatch_says_what_helped_and_how_far():
    rmse = {"nominal": 5.44, "refit": 5.02, "augmented": 5.02, "suspected": 0.186}
    gap = {"value": 5.01e-4, "unit": "m", "ci95": [4.6e-4, 5.4e-4]}
    test = {"log_odds_left": 15.0, "sure": 3.0, "cause": "", "share_left": 0.4}
    record = {
        "verdict": "unknown", "effects": [], "location": [], "hypotheses": [{}] * 35, "absorbed": {}, "steps": [],
        "notes": [], "about": {}, "test": test,
        "suspected": [{"name": "backlash", "hypothesis": "backlash", "confidence": 0.9, "equation": "play",
                       "parameters": {"gap": gap}}],
        "fit": {"drive_tension": {"unit": "N", "noise_floor": 0.1, "heldout_rmse": rmse}},
    }  # fmt: skip
    assert headline(record) == (
        "Something is missing. The fit improves with backlash, but 40 % of the mismatch is unexplained, "
        "and that is not noise (odds 10^7 to 1)."
    )
    worse = {**record, "test": {**test, "log_odds_left": 0.3}}
    assert headline(worse) == (
        "Something is missing. The fit improves with backlash, but a channel is predicted worse than by its own mean."
    )
    alike = {**worse, "suspected": [{**record["suspected"][0], "alternatives": ["viscoelastic_creep"]}]}
    assert headline(alike).endswith("improves with backlash, but unlike laws do as well.")
    assert "and 0.186 N with backlash" in cost(record) and "--effect-file" in advice(record)
    assert "    gap = 0.501 mm (95 %: 0.46 mm to 0.54 mm)" in lines(record)
    nothing = {**record, "suspected": []}
    assert "none of the 35 effects" in headline(nothing)
    assert "backlash" not in cost(nothing)

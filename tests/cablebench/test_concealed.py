"""The concealed track: rigs are drawn one by one, sealed, and told to nobody; rows are scored, kept and summed up."""

import json

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cable_envs.sim.rigs import load_rig
from cablebench.concealed import page, worth
from cablebench.concealed.entrants import ROWS, Row, row_from_file
from cablebench.concealed.given import Episodes, Given
from cablebench.concealed.hidden import KINDS, drawn, from_key
from cablebench.concealed.learners import controller, corrected, shipped_gains, tuned_on_the_rig
from cablebench.concealed.mechanism import load_mechanism, mechanisms
from cablebench.concealed.records import record_hidden
from cablebench.concealed.track import answer, run, sealed

HOLE, CIRCUIT = "hole", "circuit"
LIBRARY = 0
"""Number of a rig with one effect of the library, whose kernel is that of the plant."""


@pytest.fixture(scope="module")
def hole():
    return load_mechanism(HOLE)


@pytest.mark.parametrize("name", mechanisms())
def test_a_rig_depends_on_its_number_alone_and_is_a_rig(name):
    mechanism, kinds = load_mechanism(name), set()
    for number in range(12):
        hidden = drawn(mechanism, 5, number)
        assert hidden == drawn(mechanism, 5, number) != drawn(mechanism, 6, number)
        assert from_key(json.loads(json.dumps(hidden.key()))) == hidden
        setup = setup_of(mechanism.env, hidden.options(mechanism))
        assert set(hidden.effects) <= {name.split(".")[0] for name in setup.rig.effects} | {
            effect for effect in hidden.effects if f"{effect}.{next(iter(hidden.effects[effect]))}" in _aliases(setup)
        }
        for parameter, value in hidden.parameters.items():
            assert setup.rig.values[parameter] == pytest.approx(value)
            assert value != load_rig(mechanism.preset).values[parameter]
        kinds.add(hidden.kind)
    assert kinds == set(KINDS)


def _aliases(setup):
    return setup.plant.effects.aliases


def test_a_key_that_is_another_one_is_refused(tmp_path, hole):
    first = sealed(hole, tmp_path, 3, 5)
    assert first == sealed(hole, tmp_path, 3, None)  # those that are there
    with pytest.raises(ConfigurationError, match="3 sealed rigs, not 4"):
        sealed(hole, tmp_path, 4, 5)
    file = tmp_path / "keys" / "rig-01.json"
    content = json.loads(file.read_text())
    content["key"]["parameters"]["friction_coefficient"] = 0.4
    file.write_text(json.dumps(content))
    with pytest.raises(ConfigurationError, match="not the key that was sealed"):
        sealed(hole, tmp_path, 3, 5)


def test_the_recording_states_the_rig_that_everybody_believes_in(tmp_path, hole):
    hidden = drawn(hole, 5, LIBRARY)
    file = record_hidden(hidden, hole, tmp_path / "recording")
    text = file.read_text()
    told = yaml.safe_load(text)
    believed = load_rig(hole.preset).values
    for name, entry in {**told["known"], **told["nominal"]}.items():
        assert name == "hole_radius" or entry["value"] == believed[name]
    assert not any(effect in text for effect in hidden.effects)
    assert [record["use"] for record in told["records"]] == ["fit"] * (hole.bench["records"] - 1) + ["heldout"]
    before = {path: path.read_bytes() for path in file.parent.iterdir()}
    assert record_hidden(hidden, hole, tmp_path / "recording") == file  # taken as it is
    assert before == {path: path.read_bytes() for path in file.parent.iterdir()}


def test_episodes_on_the_hidden_rig_are_counted(hole):
    hidden = drawn(hole, 5, LIBRARY)
    allowed = Episodes(hole.env, {**hidden.options(hole), "duration": 4.0}, 2)
    from cablebench.protocol.actors import ControllerActor

    class Still:
        def reset(self):
            pass

        def act(self, t, y, ref):
            return 30.0

    def still(setup):
        return ControllerActor(Still(), setup)

    first = allowed.run(still)
    assert allowed.run(still)["rmse"] == first["rmse"] and allowed.used == 2
    with pytest.raises(ConfigurationError, match="all 2 episodes"):
        allowed.run(still)


def test_rows_are_scored_once_and_an_entrant_of_ones_own_among_them(tmp_path, hole):
    file = tmp_path / "mine.py"
    file.write_text(
        '"""The linear quadratic regulator as it is shipped."""\n'
        "from cablebench.concealed.learners import controller, shipped_gains\n\n\n"
        "name = 'mine'\n\n\n"
        "def prepare(given):\n"
        "    return controller(given, 'lqg', shipped_gains('lqg-suite', given.mechanism.env), given.believed)\n"
    )
    heard: list[str] = []
    rows = [ROWS["nominal-controller"], row_from_file(file)]
    found = run(hole, rows, tmp_path / HOLE, 1, 2, 0, 5, heard.append)
    assert len(found) == 1 and set(found[0]["rows"]) == {"nominal-controller", "mine"}
    for row in found[0]["rows"].values():
        assert len(row["scores"]) == len(row["errors"]) == len(row["failed"]) == 2
        assert all(-1.0 <= s <= 1.2 for s in row["scores"])
    assert found[0]["answer"] is None  # neither asks for a diagnosis

    def never(given):
        raise AssertionError("it was there")

    again = run(hole, [Row("mine", never)], tmp_path / HOLE, 1, 2, 0, 5, heard.append)
    assert again[0]["rows"]["mine"] == found[0]["rows"]["mine"]


def test_more_episodes_on_the_rig_go_on_with_fewer(hole, tmp_path):
    hidden = drawn(hole, 5, LIBRARY)
    allowed = Episodes(hole.env, {**hidden.options(hole), "duration": 4.0}, 6)
    about = Given(hole, tmp_path / "recording", tmp_path, tmp_path / "shared", allowed)
    acting = setup_of(hole.env, hidden.options(hole))

    def gains(count):
        return dict(tuned_on_the_rig(about, count)(acting).controller.gains)

    few = gains(2)
    assert allowed.used == 2
    gains(4)
    assert allowed.used == 4
    assert gains(2) == few and allowed.used == 4  # later trials are none of theirs


def test_a_row_plays_the_mechanisms_that_it_enters():
    circuit = load_mechanism("circuit")
    assert not ROWS["adaptive-controller"].enters(circuit) and ROWS["adaptive-controller"].enters(load_mechanism(HOLE))


def test_a_file_that_is_no_entrant_is_refused(tmp_path):
    file = tmp_path / "mine.py"
    for text, said in (
        ("", "define prepare"),
        ("name = 'oracle-agent'\ndef prepare(given): ...", "a name that no row has"),
        ("episodes = -1\ndef prepare(given): ...", "at least 0"),
    ):
        file.write_text(text)
        with pytest.raises(ConfigurationError, match=said):
            row_from_file(file)


def test_a_controller_believes_the_rig_that_it_is_told(hole, tmp_path):
    from cablebench.concealed.given import given

    hidden = drawn(hole, 5, LIBRARY)
    about = given(hidden, hole, tmp_path, 0, 0, lambda text: None)
    acting = setup_of(hole.env, hidden.options(hole))
    gains = shipped_gains(hole.controller["gains"], hole.env)
    told = controller(about, hole.controller["name"], gains, {"rig": {"plant": "cable_hole", "extends": hole.preset,
                      "parameters": {"friction_coefficient": {"value": 0.2, "unit": "1"}}}})(acting)  # fmt: skip
    assert told.controller.rig["friction_coefficient"] == 0.2
    plain = controller(about, hole.controller["name"], gains, about.believed)(acting)
    assert plain.controller.rig["friction_coefficient"] == load_rig(hole.preset).values["friction_coefficient"]


def test_where_the_corrected_rig_cannot_be_simulated_the_believed_one_is_taken(hole, tmp_path):
    from cablebench.concealed.given import given

    heard: list[str] = []
    about = given(drawn(hole, 5, LIBRARY), hole, tmp_path, 0, 0, heard.append)
    (about.folder / "diagnosis").mkdir(parents=True)
    rig = about.folder / "diagnosis" / "augmented.yaml"
    quick = {"load_mass": {"value": 1e-6, "unit": "kg"}, "cable_stiffness": {"value": 1e7, "unit": "N/m"}}
    for parameters, taken in (({}, "corrected"), (quick, hole.preset)):
        rig.write_text(yaml.safe_dump({
            "plant": "cable_hole", "name": "corrected", "extends": hole.preset, "parameters": parameters,
        }))  # fmt: skip
        found = corrected(about)["rig"]
        assert (found if isinstance(found, str) else found["name"]) == taken
    assert len(heard) == 1 and "cannot be simulated" in heard[0]


def made_up(answers):
    """Rigs whose diagnosed controller has a factor e of the nominal one's error where the answer is right."""
    rigs = []
    for number, (verdict, named) in enumerate(answers):
        gain = 1.0 if named == ["backlash"] else 0.0
        rows = {
            "nominal-controller": {"scores": [0.4, 0.6], "errors": [1e-3, 1e-3], "failed": [False, False]},
            "diagnosed-controller": {
                "scores": [0.4 + gain, 0.6 + gain], "errors": [1e-3 * np.exp(-gain)] * 2, "failed": [False, True],
            },
            "oracle-controller": {"scores": [1.4, 1.6], "errors": [1e-3 * np.exp(-1.0)] * 2, "failed": [False, False]},
            "tuned-on-the-rig-4": {"scores": [0.5, 0.7], "errors": [9e-4] * 2, "failed": [False, False]},
        }  # fmt: skip
        hidden = {"number": number, "kind": KINDS[number % 3], "effects": {"backlash": {"gap": 1e-3}}}
        rigs.append({"hidden": hidden, "rows": rows, "answer": {"verdict": verdict, "named": named}})
    return rigs


ANSWERS = [("named", ["backlash"]), ("unknown", []), ("named", ["slack"]), ("no_detectable_mismatch", [])]


def test_a_spring_that_the_refit_finds_counts_as_named(hole, tmp_path):
    assert answer(tmp_path, hole) is None
    (tmp_path / "diagnosis").mkdir()
    said = {
        "verdict": "no_detectable_mismatch", "effects": [],
        "absorbed": {
            "load_stiffness": {"before": 0.0, "ci95": [247.0, 249.0]},
            "load_damping": {"before": 0.0, "ci95": [-0.2, 0.9]},
            "friction_coefficient": {"before": 0.43, "ci95": [0.47, 0.48]},  # nobody is told it exactly
        },
    }  # fmt: skip
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(said))
    told = answer(tmp_path, hole)
    assert told == {"verdict": "no_detectable_mismatch", "named": ["position_dependent_load"]}
    said["effects"] = [{"name": "position_dependent_load"}]  # found in both ways it is one name
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(said))
    assert answer(tmp_path, hole)["named"] == ["position_dependent_load"]
    rig = {"hidden": {"effects": {"position_dependent_load": {"stiffness": 248.0}}}, "answer": told}
    assert worth.answered(rig) == "right"
    assert worth.answered({**rig, "answer": {**told, "verdict": "unknown"}}) == "unknown"


def test_what_a_diagnosis_is_worth_is_told_by_its_answer():
    rigs = made_up(ANSWERS)
    assert [worth.answered(rig) for rig in rigs] == [worth.ANSWERS[k] for k in (0, 2, 1, 3)]
    found = {
        one["answer"]: one
        for one in worth.diagnosis(rigs, *(f"{w}-controller" for w in ("diagnosed", "nominal", "oracle")))
    }
    assert found["right"]["times"].value == pytest.approx(np.e) and found["right"]["better"] == 1
    assert found["unknown"]["times"].value == pytest.approx(1.0) and found["unknown"]["better"] == 0
    assert found["all"]["times"].value == pytest.approx(np.exp(0.25)) and found["all"]["rigs"] == 4
    assert found["all"]["oracle"].value == pytest.approx(np.e)
    standing = {entry["row"]: entry for entry in worth.standing(rigs)}
    assert standing["diagnosed-controller"]["score"].value == pytest.approx(0.75)
    assert standing["diagnosed-controller"]["ahead"].value == pytest.approx(0.25)
    assert standing["diagnosed-controller"]["failed"] == 4 and "ahead" not in standing["nominal-controller"]
    (saved,) = worth.episodes_saved(rigs, "diagnosed-controller")
    assert saved["episodes"] == 4 and saved["ahead"].value == pytest.approx(0.15)


def test_rows_without_the_nominal_controller_have_tables_too():
    rigs = made_up(ANSWERS)
    for rig in rigs:
        del rig["rows"]["nominal-controller"]
    assert all("ahead" not in entry for entry in worth.standing(rigs))
    assert "| `diagnosed-controller` | recordings | 0.75" in page.tables({HOLE: rigs})


def test_the_page_has_every_rig_and_keeps_what_people_wrote(tmp_path):
    result = {HOLE: made_up(ANSWERS)}
    text = page.tables(result)
    assert text.count("backlash.gap = 0.001") == 4 and "| right | 1 | 2.72 | 2.72 |" in text
    file = tmp_path / "page.md"
    file.write_text(f"# Mine\n\n{page.BEGIN}\nold\n{page.END}\nafter\n")
    page.write_tables(file, result)
    assert file.read_text().startswith("# Mine\n") and file.read_text().endswith(f"{page.END}\nafter\n")
    assert "old" not in file.read_text() and text.strip() in file.read_text()
    file.write_text("# Mine\n")
    with pytest.raises(ConfigurationError, match="the page lacks"):
        page.write_tables(file, result)


def test_tables_of_another_mechanism_stay_on_the_page(tmp_path):
    file = tmp_path / "page.md"
    file.write_text(f"{page.BEGIN}\n{page.END}\n")
    hole, circuit = ({name: made_up(ANSWERS)} for name in (HOLE, CIRCUIT))
    page.write_tables(file, circuit)
    page.write_tables(file, hole)
    both = file.read_text()
    assert all(page.tables(one).strip() in both for one in (hole, circuit))
    page.write_tables(file, hole)
    assert file.read_text() == both


def test_a_page_that_cannot_take_the_tables_is_refused_before_any_rig_is_drawn(tmp_path, cli):
    words = ["concealed", "--mechanism", HOLE, "--rigs", "1", "--out", tmp_path / "out", "--page"]
    code, _, error = cli(*words, tmp_path / "none.md")
    assert code == 2 and "no page" in error and page.BEGIN in error
    unmarked = tmp_path / "unmarked.md"
    unmarked.write_text("# Mine\n")
    code, _, error = cli(*words, unmarked)
    assert code == 2 and "the page lacks" in error
    assert unmarked.read_text() == "# Mine\n" and not (tmp_path / "out" / HOLE).exists()


def test_the_command_seals_records_and_goes_on(tmp_path, cli):
    words = ["concealed", "--mechanism", HOLE, "--rigs", "1", "--draw", "5", "--out", tmp_path / "out"]
    code, out, _ = cli(*words, "--recordings-only")
    assert code == 0 and "sealed and recorded" in out
    assert (tmp_path / "out" / HOLE / "rig-00" / "recording" / "recording.yaml").is_file()
    assert not (tmp_path / "out" / HOLE / "rig-00" / "scores").exists()
    code, out, _ = cli(*words, "--row", "nominal-controller", "--episodes", "1")
    assert code == 0 and "nominal-controller" in out
    assert (tmp_path / "out" / "concealed.json.xz").is_file()
    code, _, err = cli(*words, "--row", "nominal-controler")
    assert code != 0 and "did you mean 'nominal-controller'" in err

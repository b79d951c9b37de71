"""Tables of unknown origin: the mapping that is proposed, and that it imports as it is."""

import zipfile
from html import escape

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.guess.proposal import propose
from cable_envs.diagnosis.readers.guess.rates import slope_like
from cable_envs.diagnosis.readers.guess.words import unit_in, unit_of
from cable_envs.diagnosis.readers.writer import write_data_set
from cablebench.cli import main

ROWS, PERIOD = 2000, 0.004
T = PERIOD * np.arange(ROWS)
X = 0.03 * np.sin(2.0 * T) + 0.01 * np.sin(5.1 * T)  # m
V = 0.06 * np.cos(2.0 * T) + 0.051 * np.cos(5.1 * T)  # m/s
Q, W = 20.0 * X, 20.0 * V  # rad, rad/s
RNG = np.random.default_rng(1)
F = 50.0 + 5.0 * np.sign(V) + RNG.normal(0.0, 0.2, ROWS)  # N
M = 0.05 * np.sin(2.0 * T) + RNG.normal(0.0, 1e-3, ROWS)  # N m
LATER = 0.9 * np.roll(X, 5) + RNG.normal(0.0, 1e-5, ROWS)  # m, of the load
N = np.arange(ROWS)


def text(head, columns, delimiter=",", decimal=".", number="{:.9g}"):
    rows = zip(*columns, strict=True)
    cell = lambda value: value if isinstance(value, str) else number.format(value).replace(".", decimal)  # noqa: E731
    return head + "".join(delimiter.join(map(cell, row)) + "\n" for row in rows)


def _stamps():
    return [f"14.06.2026 10:{int(t // 60):02d}:{t % 60:06.3f}" for t in T]


LOGS = {
    "german, units below, latin-1": (
        "run.csv",
        text("Pruefstand 3\nStart: 14.06.2026 10:12\nZeit;Motor;M_Motor;Greifer;M_Greifer;Temp\nms;°;Nmm;°;Nmm;°C\n",
             (1e3 * T, np.degrees(Q), 1e3 * M, np.degrees(0.9 * Q), 900.0 * M, 20.0 + 0.0 * T), ";", ","),
        "pulley_circuit",
        {"time": ("Zeit", "ms"), "drive_angle": ("Motor", "deg"), "drive_torque": ("M_Motor", "N mm"),
         "output_angle": ("Greifer", "deg"), "output_torque": ("M_Greifer", "N mm")},
    ),
    "english, units in brackets, a speed command": (
        "run.csv",
        text("Sample,Time (s),Motor cmd [mm/s],Motor position [mm],Cable tension motor [N],Load position [mm]\n",
             (N, T, 1e3 * V, 1e3 * X, F, 1e3 * LATER)),
        "cable_hole",
        {"time": ("Time (s)", "s"), "drive_velocity_command": ("Motor cmd [mm/s]", "mm/s"),
         "drive_position": ("Motor position [mm]", "mm"), "drive_tension": ("Cable tension motor [N]", "N"),
         "load_position": ("Load position [mm]", "mm")},
    ),
    "a commented header, a speed that counts the other way": (
        "run.txt",
        text("# t[s] x_mm xdot F_N\n", (T, 1e3 * X, -V, F), " "),
        "linear_drive",
        {"time": (1, "s"), "position": (2, "mm"), "velocity": (3, "m/s", {"sign": -1}), "force": (4, "N")},
    ),
    "no unit, but that of the speed": (
        "run.csv",
        text("zeit_s\tWeg\tGeschw [m/s]\tKraft [kN]\n", (T, 1e3 * X, V, 1e-3 * F), "\t"),
        "linear_drive",
        {"time": ("zeit_s", "s"), "position": ("Weg", "mm"), "velocity": ("Geschw [m/s]", "m/s"),
         "force": ("Kraft [kN]", "kN")},
    ),
    "inches, pounds and no unit of time": (
        "run.csv",
        text('"time","carriage in [in]","speed [in/s]","load cell [lbf]"\n',
             (1e3 * T, X / 0.0254, V / 0.0254, F / 4.4482216)),
        "linear_drive",
        {"time": ("time", "ms"), "position": ("carriage in [in]", "m", {"scale": 0.0254}),
         "velocity": ("speed [in/s]", "m/s", {"scale": 0.0254}),
         "force": ("load cell [lbf]", "N", {"scale": 4.448221615})},
    ),
    "a joint with its current, a speed in deg_s": (
        "arm.csv",
        text("t_ms,angle_deg,speed_deg_s,current_A,target_deg\n",
             (1e3 * T, np.degrees(Q), np.degrees(W), 10.0 * M, np.degrees(Q) + RNG.normal(0.0, 0.01, ROWS))),
        "rotary_joint",
        {"time": ("t_ms", "ms"), "position": ("angle_deg", "deg"), "velocity": ("speed_deg_s", "deg/s"),
         "current": ("current_A", "A"), "position_reference": ("target_deg", "deg")},
    ),
    "times of day as text, a reference": (
        "run.log",
        text("stamp | Soll-Weg mm | Ist-Weg mm | Spannung V\n",
             (_stamps(), 1e3 * X, 1e3 * X + RNG.normal(0.0, 0.01, ROWS), M), "|"),
        "linear_drive",
        {"time": (None, None, {"sample_rate": 250}), "position": ("Ist-Weg mm", "mm"), "voltage": ("Spannung V", "V"),
         "position_reference": ("Soll-Weg mm", "mm")},
    ),
    "counts of an encoder, degrees a second": (
        "run.csv",
        text("t_ms;Nr;Enc Motor [Ink];Enc Greifer [deg];omega Motor [deg/s];Drehmoment Motor [mNm]\n",
             (1e3 * T, N, np.rint(np.degrees(Q) / 0.09), np.degrees(0.9 * Q), np.degrees(W), 1e3 * M), ";"),
        "pulley_circuit",
        {"time": ("t_ms", "ms"), "drive_angle": ("Enc Motor [Ink]", "rad", {"scale": np.radians(0.09)}),
         "drive_torque": ("Drehmoment Motor [mNm]", "mN m"), "output_angle": ("Enc Greifer [deg]", "deg")},
    ),
    "an axis whose motor's current was recorded": (
        "needle.csv",
        text("time_ms,depth_mm,current_mA,target_mm\n", (1e3 * T, 1e3 * X, 20.0 * F, 1e3 * np.roll(X, -3))),
        "linear_drive",
        {"time": ("time_ms", "ms"), "position": ("depth_mm", "mm"), "force": ("current_mA", "N", {"scale": 1e-3}),
         "position_reference": ("target_mm", "mm")},
    ),
    "joint states as a bag's export calls them": (
        "log.csv",
        text("ros_time,joint_states/position[2],joint_states/velocity[2],joint_states/effort[2]\n",
             (1.7e9 + T, Q, W, 10.0 * M), number="{:.15g}"),
        "rotary_joint",
        {"time": ("ros_time", "s"), "position": ("joint_states/position[2]", "rad"),
         "velocity": ("joint_states/velocity[2]", "rad/s"), "torque": ("joint_states/effort[2]", "N m")},
    ),
    "a probe whose contact is measured, beside the current of its coil": (
        "probe.csv",
        text("t_s;Probe depth (um);Contact force (mN);Coil current (mA)\n", (T, 1e6 * X, 300.0 * X, 20.0 * F), ";"),
        "linear_drive",
        {"time": ("t_s", "s"), "position": ("Probe depth (um)", "um"),
         "force": ("Coil current (mA)", "N", {"scale": 1e-3})},
    ),
    "a finger's tendon and the angle of its motor": (
        "hand.csv",
        text("t (s),finger_tendon_tension_prox_N,finger_tendon_tension_dist_N,motor_encoder_deg\n",
             (T, F, 0.8 * F, np.degrees(X))),
        "cable_hole",
        {"time": ("t (s)", "s"), "drive_tension": ("finger_tendon_tension_prox_N", "N"),
         "load_tension": ("finger_tendon_tension_dist_N", "N"),
         "drive_position": ("motor_encoder_deg", "m", {"scale": np.radians(1.0)})},
    ),
    "no clock, and the rate in a comment": (
        "stage.csv",
        text("# axis 2, rate: 250 Hz\nsample,position(mm),setpoint(mm),force(N)\n",
             (N, 1e3 * X, 1e3 * np.roll(X, -2), F)),
        "linear_drive",
        {"time": (None, None, {"sample_rate": 250.0}), "position": ("position(mm)", "mm"), "force": ("force(N)", "N"),
         "position_reference": ("setpoint(mm)", "mm")},
    ),
    "each column on a clock of its own": (
        "run.csv",
        text("t1 [s];Seilweg Antrieb [mm];t2 [s];Seilkraft Antrieb [N]\n", (T, 1e3 * X, T + 0.001, F), ";", ","),
        "cable_hole",
        {"time": ("t1 [s]", "s"), "drive_position": ("Seilweg Antrieb [mm]", "mm"),
         "drive_tension": ("Seilkraft Antrieb [N]", "N", {"clock": "t2 [s]"})},
    ),
    "a bowden cable whose drive is told a place in steps": (
        "run.csv",
        text("time,cmd motor (mm),motor (mm),tip (mm),bowden force motor (N)\n",
             (T, np.round(1e3 * X[(N // 50) * 50], 1), 1e3 * X, 1e3 * LATER, F)),
        "tendon_sheath",
        {"time": ("time", "s"), "drive_position": ("motor (mm)", "mm"), "load_position": ("tip (mm)", "mm"),
         "drive_tension": ("bowden force motor (N)", "N"),
         "drive_position_command": ("cmd motor (mm)", "mm", {"hold": "step"})},
    ),
    "an arm that a tendon bends": (
        "bend1.txt",
        text("Zeit [s];Seilweg [mm];Seilkraft [N];Spitzenwinkel [Grad]\n",
             (T, 1e3 * X, F, np.degrees(X) / 0.008), ";", ","),
        "tendon_sheath",
        {"time": ("Zeit [s]", "s"), "drive_position": ("Seilweg [mm]", "mm"), "drive_tension": ("Seilkraft [N]", "N"),
         "load_position": ("Spitzenwinkel [Grad]", "m", {"scale": 0.000139626})},  # 8 mm for a radian
    ),
}  # fmt: skip
"""Log -> (file, its text, the system, channel -> (column, unit, what else the mapping says))."""


def imported(folder, path, form, found):
    """The recording that a proposal, unchanged, makes of a file."""
    (folder / "map.yaml").write_text(found.text, encoding="utf-8")
    data = reader(form).open_dataset(path, Request(folder / "map.yaml", True))
    return load_recording(write_data_set(data, folder / "out").path)


def agrees(found, system, expected):
    content = yaml.safe_load(found.text)
    assert content["system"] == system
    assert set(content["channels"]) == set(expected), found.text
    for channel, (column, unit, *more) in expected.items():
        entry = dict(content["channels"][channel])
        assert (entry.pop("column", None), entry.pop("unit", None)) == (column, unit), (channel, found.text)
        assert entry == pytest.approx(*more, rel=2e-3) if _numbers(*more) else entry == dict(*more), found.text


def _numbers(more=None):
    return bool(more) and all(isinstance(value, float) for value in more.values())


@pytest.mark.parametrize("log", LOGS)
def test_the_mapping_of_a_foreign_log_is_proposed_and_imports(log, tmp_path):
    name, content, system, expected = LOGS[log]
    path = tmp_path / name
    path.write_text(content, encoding="latin-1" if "latin" in log else "utf-8")
    found = propose(path, "table")
    agrees(found, system, expected)
    recording = imported(tmp_path, path, "table", found)
    assert set(recording.channels) == set(expected)
    record = recording.records[0].data
    place = next(c for c in ("drive_position", "position", "drive_angle") if c in record)
    truth = np.interp(
        record["time"] - record["time"][0], T, Q if place == "drive_angle" or system == "rotary_joint" else X
    )
    np.testing.assert_allclose(record[place], truth, atol=2e-3 * np.ptp(truth))


SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'
)
PARTS = {
    "[Content_Types].xml": '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="xml" ContentType="application/xml"/><Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Override PartName="/xl/workbook.xml" '
    'ContentType="application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"/></Types>',
    "_rels/.rels": '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship '
    'Id="r1" Type="http://schemas.openxmlformats.org/officeDocument/2006/relationships/officeDocument" '
    'Target="xl/workbook.xml"/></Relationships>',
    "xl/workbook.xml": '<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main" '
    'xmlns:r="http://schemas.openxmlformats.org/officeDocument/2006/relationships"><sheets>'
    '<sheet name="Info" sheetId="1" r:id="r1"/><sheet name="Messung" sheetId="2" r:id="r2"/></sheets></workbook>',
    "xl/_rels/workbook.xml.rels": '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Id="r1" Type="http://schemas.openxmlformats.org/officeDocument/2006/relationships/worksheet" '
    'Target="worksheets/sheet1.xml"/><Relationship Id="r2" '
    'Type="http://schemas.openxmlformats.org/officeDocument/2006/relationships/worksheet" '
    'Target="worksheets/sheet2.xml"/></Relationships>',
}


def xlsx(path, *sheets):
    def cell(value, k, row):
        at = f"{'ABCDEFGH'[k]}{row}"
        if isinstance(value, str):
            return f'<c r="{at}" t="inlineStr"><is><t>{escape(value)}</t></is></c>'
        return f'<c r="{at}"><v>{value:.9g}</v></c>'

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        for name, content in PARTS.items():
            book.writestr(name, content)
        for number, rows in enumerate(sheets, 1):
            lines = [f'<row r="{r}">{"".join(cell(v, k, r) for k, v in enumerate(row))}</row>'
                     for r, row in enumerate(rows, 1)]  # fmt: skip
            book.writestr(f"xl/worksheets/sheet{number}.xml", SHEET.format("".join(lines)))


def ods(path, rows):
    def cell(value):
        kind = "string" if isinstance(value, str) else "float"
        number = "" if kind == "string" else f' office:value="{value:.9g}"'
        return f'<table:table-cell office:value-type="{kind}"{number}><text:p>{value}</text:p></table:table-cell>'

    body = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    content = (
        '<office:document-content xmlns:office="urn:oasis:names:tc:opendocument:xmlns:office:1.0" '
        'xmlns:table="urn:oasis:names:tc:opendocument:xmlns:table:1.0" '
        'xmlns:text="urn:oasis:names:tc:opendocument:xmlns:text:1.0"><office:body><office:spreadsheet>'
        f'<table:table table:name="log">{body}</table:table></office:spreadsheet></office:body>'
        "</office:document-content>"
    )
    with zipfile.ZipFile(path, "w") as book:
        book.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        book.writestr("content.xml", content)
        book.writestr("META-INF/manifest.xml", "<manifest/>")


@pytest.mark.parametrize("end", [".xlsx", ".ods"])
def test_a_spreadsheet_goes_in_as_a_table_does(end, tmp_path):
    pytest.importorskip("python_calamine", reason="spreadsheets need cable-envs[sheets]")
    rows = [["Messung 7"], ["Zeit", "Weg", "Kraft"], ["s", "mm", "N"], *zip(T, 1e3 * X, F, strict=True)]
    path = tmp_path / f"log{end}"
    if end == ".xlsx":
        xlsx(path, [["nothing here"]], rows)
    else:
        ods(path, [[*row, *[""] * (3 - len(row))] for row in rows])
    found = propose(path, "table")
    agrees(found, "linear_drive", {"time": ("Zeit", "s"), "position": ("Weg", "mm"), "force": ("Kraft", "N")})
    record = imported(tmp_path, path, "table", found).records[0].data
    np.testing.assert_allclose(record["position"], X, atol=1e-9)
    np.testing.assert_allclose(record["force"], F, atol=1e-6)


def test_a_sheet_is_read_by_its_name_and_a_wrong_name_is_refused(tmp_path):
    pytest.importorskip("python_calamine", reason="spreadsheets need cable-envs[sheets]")
    rows = [["t", "x [mm]", "F [N]"], *zip(T, 1e3 * X, F, strict=True)]
    xlsx(tmp_path / "log.xlsx", [["t", "x [mm]", "F [N]"], *zip(T, 2e3 * X, F, strict=True)], rows)
    (tmp_path / "map.yaml").write_text(propose(tmp_path / "log.xlsx", "table").text)
    content = yaml.safe_load((tmp_path / "map.yaml").read_text())

    def position(sheet):
        content["layout"] = {"sheet": sheet}
        (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
        data = reader("table").open_dataset(tmp_path / "log.xlsx", Request(tmp_path / "map.yaml", True))
        path = write_data_set(data, tmp_path / sheet).path
        return load_recording(path).records[0].data["position"]

    np.testing.assert_allclose(position("Messung"), X, atol=1e-9)
    np.testing.assert_allclose(position("Info"), 2.0 * X, atol=1e-9)
    with pytest.raises(ConfigurationError, match="no sheet 'Mesung'; did you mean 'Messung'"):
        position("Mesung")


def test_vectors_of_a_matlab_file_are_found_in_structs(tmp_path):
    inner = {"pos_mm": 1e3 * X, "vel": V, "Kraft_N": F, "name": "motor"}
    savemat(tmp_path / "log.mat", {"data": {"t_ms": 1e3 * T, "antrieb": inner}, "short": np.arange(3.0)})
    found = propose(tmp_path / "log.mat", "mat")
    expected = {
        "time": ("data.t_ms", "ms"), "drive_position": ("data.antrieb.pos_mm", "mm"),
        "drive_velocity": ("data.antrieb.vel", "m/s"), "drive_tension": ("data.antrieb.Kraft_N", "N"),
    }  # fmt: skip
    agrees(found, "cable_hole", expected)
    np.testing.assert_allclose(imported(tmp_path, tmp_path / "log.mat", "mat", found).records[0].data["time"], T)


def test_units_that_contradict_the_slope_are_to_be_confirmed(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text("t [s],x [mm],v [mm/s],F [N]\n", (T, 1e3 * X, V, F)))
    found = propose(path, "table")
    assert "velocity" in found.open and "one of the two units is wrong" in found.text


def test_a_unit_of_time_that_no_logger_has_is_to_be_confirmed(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text("time [ms],x [mm],F [N]\n", (T, 1e3 * X, F)))
    found = propose(path, "table")
    assert "time" in found.open and "its step of 0.004 would be a rate of 2.5e+05 Hz" in found.text


def test_a_motor_shows_force_and_place_of_a_carriage_through_its_pulley(tmp_path):
    radius = 0.02
    path = tmp_path / "axis.csv"
    columns = (T, 1e3 * X + RNG.normal(0.0, 1e-3, ROWS), np.degrees(X / radius), F * radius)
    path.write_text(text("t_s,x_mm,motor_deg,torque_Nm\n", columns), encoding="utf-8")
    found = propose(path, "table")
    assert found.system == "linear_drive" and {"force", "motor_position"} <= set(found.open)
    channels = yaml.safe_load(found.text)["channels"]
    # noise of 1 um over a way of some cm
    assert channels["force"]["unit"] == "N" and channels["force"]["scale"] == pytest.approx(1.0 / radius, rel=1e-3)
    assert channels["motor_position"]["scale"] == pytest.approx(np.radians(radius), rel=1e-3)


def test_a_log_for_a_simulator_of_ones_own_is_imported_by_a_mapping(tmp_path):
    path = tmp_path / "bend.csv"
    path.write_text(text("t,tip,pull\n", (T, np.degrees(Q), F)), encoding="utf-8")
    mapping = tmp_path / "bend.yaml"
    mapping.write_text(
        "schema: cable-mapping/1\nsystem: own\nchannels: {time: {column: t, unit: s}, "
        "angle: {column: tip, unit: deg}, tension: {column: pull, unit: N}}\n",
        encoding="utf-8",
    )
    data = reader("table").open_dataset(path, Request(mapping=mapping))
    made = load_recording(write_data_set(data, tmp_path / "out", heldout=[]).path)
    assert made.system == "own" and made.channels["angle"].si_unit == "rad"
    assert np.allclose(made.records[0].data["angle"], Q, atol=1e-8)


def test_a_folder_says_which_file_is_at_rest(tmp_path):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "notes.xlsx").write_bytes(b"a spreadsheet of somebody, beside the logs")
    for name, moves in (("a.csv", 1.0), ("b.csv", 0.5), ("still.csv", 0.0)):
        columns = (T, 1e3 * moves * X + RNG.normal(0.0, 1e-3, ROWS), F)
        (tmp_path / "logs" / name).write_text(text("t [s],x [mm],F [N]\n", columns))
    uses = {r["file"]: r["use"] for r in yaml.safe_load(propose(tmp_path / "logs", "table").text)["records"]}
    assert uses == {"a.csv": "fit", "b.csv": "fit", "still.csv": "rest"}


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("a;b\nx;y\n", "no rows of numbers"),
        (text("", (T, X, F)), "no column is a channel of any system"),
        (text("Zeit [s];Temp [°C]\n", (T, 20.0 + T), ";"), r"no column is a channel.*Temp \[°C\]: the header says"),
    ],
)
def test_what_tells_nothing_is_refused_with_what_was_seen(content, match, tmp_path):
    (tmp_path / "log.csv").write_text(content)
    with pytest.raises(ConfigurationError, match=match):
        propose(tmp_path / "log.csv", "table")


def test_the_factor_between_a_position_and_its_speed_tells_degrees_from_radians():
    like, factor = slope_like(T, np.degrees(Q), -W)
    assert like > 0.99 and factor == pytest.approx(-180.0 / np.pi, rel=1e-3)
    assert slope_like(T, X, F)[0] < 0.9


def test_units_and_names_in_two_languages():
    said = {"Weg in mm": "mm", "F_N": "N", "Drehzahl [U/min]": "rpm", "M (Nm)": "N m", "I/mA": "mA", "Kraft [kp]": "N"}
    assert {name: unit_in(name).name for name in said} == said
    assert unit_in("Motor") is None and unit_of("Grad").si == "rad" and unit_of("Inkremente").si == "counts"


def test_the_command_writes_a_mapping_and_overwrites_none(tmp_path, capsys):
    name, content, *_ = LOGS["no unit, but that of the speed"]
    (tmp_path / name).write_text(content)

    def ran(*words):
        with pytest.raises(SystemExit) as end:
            main(list(words))
        return end.value.code or 0, capsys.readouterr().out

    order = ["import", "table", str(tmp_path / name), "--guess", "--out"]
    code, said = ran(*order, str(tmp_path / "map.yaml"))
    assert code == 0 and "confirm: system" in said and "linear_drive: fits" in said
    assert ran(*order, str(tmp_path / "map.yaml"))[0] == 2
    assert ran(*order, str(tmp_path / "folder"))[0] == 2 and not (tmp_path / "folder").exists()
    code, said = ran("inspect", str(tmp_path / "map.yaml"), "--systems")
    assert code == 0 and "linear_drive: fits; 1 fitted" in said

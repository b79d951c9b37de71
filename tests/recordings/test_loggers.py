"""MDF and MCAP files, written here by their own libraries, as recordings."""

import json

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Log, Request
from cable_envs.diagnosis.readers.series import field_of, onto, stamp
from cable_envs.diagnosis.readers.writer import write_data_set
from cablebench.cli import main

START = 1_780_000_000
"""s since 1970."""
TIME = np.arange(200) * 0.01
ANGLE, FORCE = 30.0 * np.sin(4.0 * TIME), np.cos(3.0 * TIME)


def save(folder, channels):
    content = {"schema": "cable-mapping/1", "system": "pulley_circuit", "channels": channels}
    (folder / "map.yaml").write_text(yaml.safe_dump(content))


def take(folder, form, name, out="out"):
    """(record, what was said) of an import."""
    data = reader(form).open_dataset(folder / name, Request(folder / "map.yaml"))
    done = write_data_set(data, folder / out)
    return load_recording(done.path).records[0], done


def refused(folder, form, name, match):
    with pytest.raises(ConfigurationError, match=match):
        take(folder, form, name, "refused")
    assert not (folder / "refused").exists()


MDF_CHANNELS = {
    "time": {"column": "fast:time", "unit": "s"},
    "drive_angle": {"column": "motor", "unit": "deg"},
    "output_angle": {"column": "0:jaw", "unit": "deg", "scale": 0.5},
    "output_torque": {"column": "force", "unit": "mN m"},
}


def write_mdf(path, version="4.10"):
    asammdf = pytest.importorskip("asammdf")
    slow, invalid = TIME[::2], np.arange(100) == 40
    bits = {"invalidation_bits": invalid} if version >= "4" else {}
    names = {"acq_name": "fast"} if version >= "4" else {}
    with asammdf.MDF(version=version) as file:
        fast = [
            asammdf.Signal(ANGLE, TIME, name="motor", unit="deg"),
            asammdf.Signal(2 * ANGLE, TIME, name="jaw"),
            asammdf.Signal(np.arange(200, dtype="u2"), TIME, name="count", conversion={"a": 0.5, "b": 1.0}),
        ]
        file.append(fast, **names)
        file.append([asammdf.Signal(FORCE[::2], slow, name="force", unit="N m", **bits),
                     asammdf.Signal(slow, slow, name="jaw")])  # fmt: skip
        file.append([asammdf.Signal(np.array([b"on", b"off"]), TIME[:2], name="state", encoding="utf-8")])
        file.save(path, overwrite=True)


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_mdf_channels_of_two_clocks(tmp_path, version):
    name = "run.mf4" if version >= "4" else "run.mdf"
    write_mdf(tmp_path / name, version)
    clock = "fast:time" if version >= "4" else "0:time"
    save(tmp_path, MDF_CHANNELS | {"time": {"column": clock, "unit": "s"}})
    record, done = take(tmp_path, "mdf", name)
    np.testing.assert_allclose(record.time, TIME, rtol=0, atol=1e-12)
    np.testing.assert_allclose(record.data["drive_angle"], np.radians(ANGLE), rtol=0, atol=1e-12)
    np.testing.assert_allclose(record.data["output_angle"], np.radians(ANGLE), rtol=0, atol=1e-12)
    torque = record.data["output_torque"][:-1:2]
    valid = np.arange(100) != 40 if version >= "4" else np.full(100, True)
    np.testing.assert_allclose(torque[valid], 1e-3 * FORCE[::2][valid], rtol=0, atol=1e-12)
    assert np.isnan(torque[~valid]).all() and np.isnan(record.data["output_torque"][-1])  # behind the slow clock's end
    said = " ".join(done.remarks)
    assert "channel output_torque: group 1 interpolated onto the times of group 0" in said
    assert "the file says its unit is 'N m', the mapping 'mN m'" in said and "'deg'" not in said


def test_an_mdf_conversion_and_a_clock_of_its_own(tmp_path):
    write_mdf(tmp_path / "run.mf4")
    save(tmp_path, {"time": {"column": "count", "unit": "ms"}, "drive_angle": MDF_CHANNELS["drive_angle"]})
    record, _ = take(tmp_path, "mdf", ".")
    np.testing.assert_allclose(record.time, 1e-3 * (0.5 * np.arange(200) + 1.0), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"drive_angle": {"column": "moter", "unit": "deg"}},
            "channel drive_angle: no channel 'moter'; did you mean 'mo",
        ),
        (
            {"output_angle": {"column": "jaw", "unit": "deg"}},
            "'jaw' is there 2 times; name its group: 0:jaw fast, 1:jaw",
        ),
        ({"output_angle": {"column": "2:jaw", "unit": "deg"}}, "no channel '2:jaw'; did you mean"),
        ({"drive_angle": {"column": "state", "unit": "deg"}}, "'state' holds .*, no numbers"),
        ({"drive_angle": {"column": 1, "unit": "deg"}}, "'column' must be a name, got 1"),
        ({"time": {"sample_rate": 100}}, "MDF files carry times; name the clock's column"),
    ],
)
def test_an_mdf_mapping_that_cannot_be_meant_is_refused(tmp_path, change, message):
    write_mdf(tmp_path / "run.mf4")
    save(tmp_path, MDF_CHANNELS | change)
    refused(tmp_path, "mdf", "run.mf4", message)


@pytest.mark.parametrize("kept", [10, 200, 0.5, 0.9])
def test_a_damaged_mdf_file_is_refused(tmp_path, kept, recwarn):
    write_mdf(tmp_path / "whole.mf4")
    content = (tmp_path / "whole.mf4").read_bytes()
    (tmp_path / "run.mf4").write_bytes(content[: kept if kept > 1 else int(kept * len(content))])
    save(tmp_path, MDF_CHANNELS)
    refused(tmp_path, "mdf", "run.mf4", "run.mf4 is not whole, or no MDF file")
    assert not recwarn.list  # nor an object that cannot be closed


MCAP_CHANNELS = {
    "time": {"topic": "/joints"},
    "drive_angle": {"topic": "/joints", "field": "position[0]", "unit": "deg"},
    "output_torque": {"topic": "/torque", "field": "wrench.z", "unit": "N m"},
}


def write_json(path, stamped=True, jitter=0.0, **options):
    writers = pytest.importorskip("mcap.writer")
    with path.open("wb") as stream:
        writer = writers.Writer(stream, **options)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b'{"type": "object"}')
        ids = {topic: writer.register_channel(topic, "json", schema) for topic in ("/joints", "/torque", "/other")}
        for k, t in enumerate(TIME):
            at = {"sec": START + int(t), "nsec": round(t % 1 * 1e9)}
            log_time = (START * 10**9) + round(t * 1e9) + int(jitter * (k % 3))
            joints = {"position": [ANGLE[k], None if k == 7 else 1.0], "name": "jaw", "clock": 10 * k}
            messages = [("/joints", joints)] + ([("/torque", {"wrench": {"z": FORCE[k]}})] if k % 2 == 0 else [])
            for topic, message in messages:
                content = json.dumps(message | ({"timestamp": at} if stamped else {})).encode()
                writer.add_message(ids[topic], log_time, content, log_time)
        writer.finish()


def check(record, done):
    np.testing.assert_allclose(record.time, TIME, rtol=0, atol=1e-6)
    np.testing.assert_allclose(record.data["drive_angle"], np.radians(ANGLE), rtol=0, atol=1e-12)
    np.testing.assert_allclose(record.data["output_torque"][:-1:2], FORCE[::2], rtol=0, atol=1e-6)
    assert any("/torque interpolated onto the times of /joints" in r for r in done.remarks)


@pytest.mark.parametrize("stamped", [True, False])
def test_mcap_messages_in_json(tmp_path, stamped):
    write_json(tmp_path / "run.mcap", stamped, jitter=3e6 * stamped)
    save(tmp_path, MCAP_CHANNELS)
    record, done = take(tmp_path, "mcap", "run.mcap")
    check(record, done)
    assert any("no stamps" in r for r in done.remarks) is not stamped


def test_a_field_may_be_the_clock_and_null_is_a_gap(tmp_path):
    write_json(tmp_path / "run.mcap")
    time = {"topic": "/joints", "field": "clock", "unit": "ms"}
    save(tmp_path, MCAP_CHANNELS | {
        "time": time, "output_angle": {"topic": "/joints", "field": "position[1]", "unit": "rad"}})  # fmt: skip
    record, done = take(tmp_path, "mcap", "run.mcap")
    check(record, done)
    assert np.flatnonzero(np.isnan(record.data["output_angle"])).tolist() == [7]


def test_mcap_messages_of_ros_2(tmp_path):
    writers = pytest.importorskip("mcap_ros2.writer")
    stamp_of = "std_msgs/Header header\n"
    ends = "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ends += "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = writers.Writer(stream)
        joints = writer.register_msgdef("rig_msgs/msg/Joints", f"{stamp_of}float64[] position\n{ends}")
        torque = writer.register_msgdef(
            "rig_msgs/msg/Torque", f"{stamp_of}rig_msgs/Z wrench\n{ends}{'=' * 80}\nMSG: rig_msgs/Z\nfloat64 z\n"
        )
        for k, t in enumerate(TIME):
            header = {"stamp": {"sec": START + int(t), "nanosec": round(t % 1 * 1e9)}, "frame_id": ""}
            now = START * 10**9 + k
            writer.write_message("/joints", joints, {"header": header, "position": [ANGLE[k]]}, now)
            if k % 2 == 0:
                writer.write_message("/torque", torque, {"header": header, "wrench": {"z": FORCE[k]}}, now)
        writer.finish()
    save(tmp_path, MCAP_CHANNELS)
    check(*take(tmp_path, "mcap", "run.mcap"))
    wrong = {"drive_angle": {"topic": "/joints", "field": "positon[0]", "unit": "deg"}}
    save(tmp_path, MCAP_CHANNELS | wrong)
    refused(
        tmp_path, "mcap", "run.mcap", "channel drive_angle: /joints: no field 'positon.0.'; did you mean 'position'"
    )


def test_mcap_messages_in_protobuf(tmp_path):
    writers = pytest.importorskip("mcap_protobuf.writer")
    kinds = _protobuf_messages()
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = writers.Writer(stream)
        for k, t in enumerate(TIME):
            at = {"seconds": START + int(t), "nanos": round(t % 1 * 1e9)}
            writer.write_message("/joints", kinds["Joints"](timestamp=at, position=[ANGLE[k]]), START * 10**9 + k)
            if k % 2 == 0:
                torque = kinds["Torque"](timestamp=at, wrench={"z": FORCE[k]})
                writer.write_message("/torque", torque, START * 10**9 + k)
        writer.finish()
    save(tmp_path, MCAP_CHANNELS)
    check(*take(tmp_path, "mcap", "run.mcap"))
    save(tmp_path, MCAP_CHANNELS | {"drive_angle": {"topic": "/joints", "field": "angle", "unit": "deg"}})
    refused(tmp_path, "mcap", "run.mcap", "/joints: no field 'angle'; Valid: position, timestamp")


def _protobuf_messages():
    """Classes of messages that are declared here, as a compiler of Protobuf would make them."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    kinds = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="rig.proto", package="rig", syntax="proto3")
    file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
    z = file.message_type.add(name="Z")
    z.field.add(name="z", number=1, type=kinds.TYPE_DOUBLE, label=kinds.LABEL_OPTIONAL)
    for name, field in (("Joints", "position"), ("Torque", "wrench")):
        message = file.message_type.add(name=name)
        message.field.add(name="timestamp", number=1, type=kinds.TYPE_MESSAGE, label=kinds.LABEL_OPTIONAL,
                          type_name=".google.protobuf.Timestamp")  # fmt: skip
        if name == "Joints":
            message.field.add(name=field, number=2, type=kinds.TYPE_DOUBLE, label=kinds.LABEL_REPEATED)
        else:
            message.field.add(name=field, number=2, type=kinds.TYPE_MESSAGE, label=kinds.LABEL_OPTIONAL,
                              type_name=".rig.Z")  # fmt: skip
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return {
        name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"rig.{name}"))
        for name in ("Joints", "Torque")
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": {"topic": "/joint"}}, "no topic '/joint'; did you mean '/joints'"),
        ({"output_angle": {"topic": "/other", "field": "x", "unit": "deg"}}, "topic '?/other'?"),
        (
            {"drive_angle": {"topic": "/joints", "field": "position[2]", "unit": "deg"}},
            "there are 2 values, counted from 0",
        ),
        ({"drive_angle": {"topic": "/joints", "field": "positions[0]", "unit": "deg"}}, "did you mean 'position'"),
        ({"drive_angle": {"topic": "/joints", "field": "name", "unit": "deg"}}, "'name' is str, no number"),
        ({"drive_angle": {"topic": "/joints", "field": "name[0]", "unit": "deg"}}, "name holds no values to count"),
        ({"drive_angle": {"topic": "/joints", "field": "position", "unit": "deg"}}, "'position' is list, no number"),
        ({"drive_angle": {"topic": "/joints", "unit": "deg"}}, r"messages need {topic, field, unit}"),
        ({"time": {"sample_rate": 100}}, "MCAP needs {topic}, its messages carry times"),
    ],
)
def test_an_mcap_mapping_that_cannot_be_meant_is_refused(tmp_path, change, message):
    write_json(tmp_path / "run.mcap")
    save(tmp_path, MCAP_CHANNELS | change)
    refused(tmp_path, "mcap", "run.mcap", message)


@pytest.mark.parametrize("kept", [4, 0.3, 0.99])
def test_a_damaged_mcap_file_is_refused(tmp_path, kept):
    write_json(tmp_path / "whole.mcap")
    content = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(content[: kept if kept > 1 else int(kept * len(content))])
    save(tmp_path, MCAP_CHANNELS)
    refused(tmp_path, "mcap", "run.mcap", "run.mcap is not whole, or no MCAP file")


def test_bits_that_fell_over_are_noticed(tmp_path):
    compression = pytest.importorskip("mcap.writer").CompressionType.NONE
    write_json(tmp_path / "run.mcap", compression=compression)
    content = bytearray((tmp_path / "run.mcap").read_bytes())
    content[content.index(b'"clock"') + 1] ^= 2
    (tmp_path / "run.mcap").write_bytes(bytes(content))
    save(tmp_path, MCAP_CHANNELS)
    refused(tmp_path, "mcap", "run.mcap", "run.mcap is not whole, or no MCAP file")


def test_an_encoding_that_nothing_reads_is_named(tmp_path, monkeypatch):
    writers = pytest.importorskip("mcap.writer")
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = writers.Writer(stream)
        writer.start()
        schema = writer.register_schema("any", "flatbuffer", b"")
        channel = writer.register_channel("/joints", "flatbuffer", schema)
        writer.add_message(channel, 1, b"x", 1)
        writer.finish()
    save(tmp_path, {n: e for n, e in MCAP_CHANNELS.items() if n != "output_torque"})
    refused(
        tmp_path, "mcap", "run.mcap", "topic /joints is in 'flatbuffer' with 'flatbuffer' definitions, which nothing"
    )
    from cable_envs.diagnosis.readers.formats import mcap

    monkeypatch.setattr(mcap, "_DECODERS", {"mcap_flat.decoder": "mcap-flat-support"})
    refused(tmp_path, "mcap", "run.mcap", r"mcap-flat-support may: pip install 'cable-envs\[mcap\]'")


@pytest.mark.parametrize("form", ["mdf", "mcap"])
def test_the_command_imports_them(tmp_path, form, capsys):
    if form == "mdf":
        write_mdf(tmp_path / "run.mf4")
    else:
        write_json(tmp_path / "run.mcap")
    save(tmp_path, MDF_CHANNELS if form == "mdf" else MCAP_CHANNELS)
    words = ["import", form, str(tmp_path), "--mapping", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "out")]
    with pytest.raises(SystemExit) as end:
        main([*words, "--json"])
    assert not end.value.code and json.loads(capsys.readouterr().out)["rows"] == {"run.csv": 200}
    assert load_recording(tmp_path / "out").source["command"].startswith(f"cablebench import {form} ")


def test_stamps_of_all_kinds():
    log = Log("run")
    times = [
        stamp({"header": {"stamp": {"sec": START, "nanosec": 5}}}, 0, "/a", log),
        stamp({"timestamp": {"seconds": START, "nanos": 5}}, 0, "/a", log),
    ]
    assert times == [START - 946_684_800 + 5e-9] * 2 and not log.remarks
    assert stamp({"timestamp": {"sec": 0, "nsec": 0}}, START * 10**9, "/a", log) == START - 946_684_800
    assert "no stamps" in log.remarks[0]
    assert field_of({"a": [{"b": 2}]}, "a[0].b", "x") == 2.0


def test_nothing_is_interpolated_over_a_hole_or_beyond_the_ends():
    at = np.r_[0.0, 1.0, 2.0, 3.0, 10.0, 11.0]
    found = onto(np.r_[-1.0, 0.5, 3.0, 5.0, 10.5, 12.0], at, at)
    np.testing.assert_array_equal(found, [np.nan, 0.5, 3.0, np.nan, 10.5, np.nan])

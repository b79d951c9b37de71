"""What of a recording a model uses, and what the gate therefore asks of it."""

from dataclasses import replace

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.intake import gate as gate_module
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.intake.tracks import was_told
from cable_envs.diagnosis.systems.question import Look
from tests.support import drive_recording as drive


@pytest.fixture
def recording(tmp_path):
    return load_recording(drive.write(tmp_path / "recording"))


def test_samples_count_as_the_model_takes_them(recording, monkeypatch):
    total = sum(len(r.time) for r in recording.records)
    monkeypatch.setattr(gate_module, "MOST", total // 2)
    with pytest.raises(ConfigurationError, match=f"{total} rows make {total} samples"):
        gate(recording).require_usable()
    period = float(np.median(np.diff(recording.records[0].time)))
    gate(recording, Look(spacing=4 * period)).require_usable()


def test_a_jump_that_the_model_leaves_out_is_noted_and_no_more(recording):
    first = recording.records[0]
    data = {**first.data, "position": first.data["position"].copy()}
    data["position"][0] += 10.0 * np.ptp(data["position"])
    spoilt = replace(recording, records=(replace(first, data=data), *recording.records[1:]))
    with pytest.raises(ConfigurationError, match="row 2: a jump by"):
        gate(spoilt).require_usable()
    quality = gate(spoilt, Look(edge=0.5))
    quality.require_usable()
    assert any("within 0.5 s of the end, which is left out" in note for note in quality.notes)


def test_a_record_that_is_only_predicted_may_be_short(recording):
    def cut(record, use):
        return replace(record, use=use, data={n: v[:120] for n, v in record.data.items()})

    first, *rest = recording.records
    gate(replace(recording, records=(*rest, cut(first, "heldout")))).require_usable()
    with pytest.raises(ConfigurationError, match="120 samples; 200 are the least"):
        gate(replace(recording, records=(*rest, cut(first, "fit")))).require_usable()


@pytest.mark.parametrize(("late", "refused"), [(1, False), (3, False), (0, True), (4, True), (-1, True)])
def test_a_jump_that_the_rig_was_told_to_make_is_none_of_the_log(recording, late, refused):
    """A servo answers its command's first step after it; in the same row, two records were put together."""
    first = recording.records[0]
    jump = len(first.time) // 2
    position, asked = first.data["position"].copy(), np.zeros(len(first.time))
    position[jump:] += 10.0 * np.ptp(position)
    asked[jump - late :] = 1.0
    assert was_told(replace(first, data={"time": first.time, "command": asked}), jump + 1, {"command"}, 30.0) != refused
    told = replace(first, data={**first.data, "position": position, "position_reference": asked})
    channels = {**recording.channels, "position_reference": recording.channels["position"]}
    spoilt = replace(recording, channels=channels, records=(told,))
    assert any(f.jump for f in gate(spoilt).faults) == refused

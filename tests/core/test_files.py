"""JSON files: compressed or plain, the same content; what is damaged is said."""

import json

import pytest

from cable_envs.core.files import packed_json, read_json

VALUE = {"rows": [1, 2.5, None, "µm"], "nested": {"a": True}}


def test_both_forms_hold_the_same(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(VALUE), encoding="utf-8")
    (tmp_path / "a.json.xz").write_bytes(packed_json(VALUE))
    assert read_json(tmp_path / "a.json") == read_json(tmp_path / "a.json.xz") == VALUE
    assert packed_json(VALUE) == packed_json(dict(VALUE))  # no time of day in it


def test_damaged_files_are_refused(tmp_path):
    (tmp_path / "cut.json.xz").write_bytes(packed_json(VALUE)[:-9])
    (tmp_path / "plain.json.xz").write_text("{}")
    (tmp_path / "half.json").write_text("{")
    for name, said in (("cut.json.xz", "damaged"), ("plain.json.xz", "damaged"), ("half.json", "Expecting")):
        with pytest.raises(ValueError, match=said):
            read_json(tmp_path / name)
    with pytest.raises(ValueError, match="not JSON compliant"):
        packed_json({"x": float("nan")})

"""Records that are kept as columns come back to the byte, or are refused."""

import json

import pytest

from cable_envs.core.config import config_root
from cablebench.run.columns import HEAD, from_columns, to_columns
from cablebench.run.store import ResultStore

AWKWARD = (
    '{"a":[1,-2.5e-300,3],"b":{"a":null,"c":"x:12,3]"},"d":1E+5}',
    '{"a":[1],"text":"caf\u00e9 \\u0000 \\" :7,"}',
    "not json at all: [4,",
    "",
    '{"a":[0.1,2,3],"b":{"a":true,"c":":12,"},"d":0}',
)


def test_lines_come_back_to_the_byte():
    whole = "".join(f"{line}\n" for line in (*AWKWARD, *AWKWARD[::-1])).encode()
    assert to_columns(whole).startswith(HEAD) and from_columns(to_columns(whole)) == whole


@pytest.mark.parametrize("content", [b"", b"\n", b'{"a":1}', b'{"a":"\0"}\n', b"{}\n"])
def test_what_has_no_columns_comes_back_too(content):
    assert from_columns(to_columns(content)) == content


def test_numbers_of_one_name_are_beside_each_other():
    lines = b"".join(b'{"rmse":0.%d,"seed":%d}\n' % (k, k) for k in range(3))
    assert to_columns(lines).endswith(b"\n0.0 0.1 0.2\n0 1 2\n")


@pytest.mark.parametrize(
    "damage", [lambda c: c[:-9], lambda c: c.replace(b"\n2\n", b"\n3\n"), lambda c: c[: len(HEAD)]]
)
def test_damaged_columns_are_refused(damage):
    content = to_columns(b'{"rmse":0.5}\n{"rmse":0.25,"n":1}\n')
    with pytest.raises(ValueError, match=r"^damaged: its columns do not fit together"):
        from_columns(damage(content))


def test_the_published_boards_are_columns_and_packing_them_again_changes_no_byte(tmp_path):
    for name in ("quick", "suite-v1"):
        published = ResultStore(config_root().parent / "boards" / name / "records.jsonl")
        lines = published._unpacked()
        assert to_columns(lines).startswith(HEAD) and from_columns(to_columns(lines)) == lines
        assert all(json.loads(line) for line in lines.splitlines()[:5])

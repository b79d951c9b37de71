"""Every malformed policy.zip ends in one line that names the file and what is wrong; none runs code."""

import io
import json
import os
import pickle
import stat
import struct
import warnings
import zipfile

import pytest
import torch

from cable_envs.agents.foreign import load_foreign
from cable_envs.agents.policy import load_policy
from cable_envs.core.errors import ConfigurationError
from tests.agents.test_foreign_policy import HOLE

MARK = "sprung"


class Trap:
    """Makes a file when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, (MARK,)


def packed(thing):
    buffer = io.BytesIO()
    torch.save(thing, buffer)
    return buffer.getvalue()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """(entries of a whole policy.zip, its metadata, its weights)."""
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train

    folder = tmp_path_factory.mktemp("policy")
    changes = {"n_envs": 2, "n_steps": 8, "batch_size": 16, "policy_kwargs": {"net_arch": [8]}}
    train(load_settings("ppo", HOLE, 16, changes=changes), 0, folder)
    with zipfile.ZipFile(folder / "policy.zip") as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(entries["cable-policy.json"])
    return entries, data, torch.load(io.BytesIO(entries["policy.pth"]), weights_only=True)


def zipped(entries):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def meta(change):
    """A policy whose metadata are changed: ``change`` gets them and may give others."""

    def made(entries, data, weights):
        other = json.loads(json.dumps(data))
        given = change(other)
        return zipped({**entries, "cable-policy.json": json.dumps(other if given is None else given)})

    return made


def put(key, value):
    def change(data):
        place, _, last = key.rpartition(".")
        (data[place] if place else data)[last] = value

    return meta(change)


def weighed(change):
    def made(entries, data, weights):
        other = {k: v.clone() for k, v in weights.items()}
        given = change(other)
        return zipped({**entries, "policy.pth": packed(other if given is None else given)})

    return made


def first(value):
    def change(weights):
        weights[next(iter(weights))] = value(weights[next(iter(weights))])

    return weighed(change)


def raw(change):
    return lambda entries, data, weights: change(zipped(entries))


def with_entry(name, content=b"x", mode=0):
    def made(entries, data, weights):
        buffer = io.BytesIO(zipped(entries))
        with zipfile.ZipFile(buffer, "a") as archive, warnings.catch_warnings(action="ignore"):  # names twice
            info = zipfile.ZipInfo(name)
            info.external_attr = mode << 16
            archive.writestr(info, content)
        return buffer.getvalue()

    return made


def bomb(name):
    """An entry that unpacks to 300 MB of zeros."""
    return lambda entries, data, weights: zipped({**entries, name: bytes(300 * 2**20)})


def inner_bomb(entries, data, weights):
    buffer = io.BytesIO(entries["policy.pth"])
    with zipfile.ZipFile(buffer, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data/99", bytes(300 * 2**20))
    return zipped({**entries, "policy.pth": buffer.getvalue()})


def lying_size(content):
    """The central directory says that the weights are far larger than they are."""
    place = content.rindex(b"policy.pth") - 46
    return content[: place + 24] + struct.pack("<I", 2**31) + content[place + 28 :]


def encrypted(content):
    place = content.rindex(b"policy.pth") - 46
    return content[: place + 8] + struct.pack("<H", 1) + content[place + 10 :]


def flipped(content):
    place = content.index(b"cable-policy.json") + 400
    return content[:place] + bytes(b ^ 255 for b in content[place : place + 20]) + content[place + 20 :]


WRONG = {
    "empty": raw(lambda c: b""),
    "no zip": raw(lambda c: b"hello " * 100),
    "a pickle": raw(lambda c: pickle.dumps(Trap())),
    "truncated": raw(lambda c: c[: len(c) // 2]),
    "its end cut off": raw(lambda c: c[:-10]),
    "flipped bytes": raw(flipped),
    "a lying size": raw(lying_size),
    "encrypted": raw(encrypted),
    "no metadata": lambda e, d, w: zipped({k: v for k, v in e.items() if k != "cable-policy.json"}),
    "no weights": lambda e, d, w: zipped({k: v for k, v in e.items() if k != "policy.pth"}),
    "metadata twice": with_entry("cable-policy.json", b"{}"),
    "weights twice": with_entry("policy.pth"),
    "a name that climbs": with_entry("../../climbed"),
    "a name with backslashes": with_entry("..\\..\\climbed"),
    "an absolute name": with_entry("/etc/climbed"),
    "a link": with_entry("link", b"/etc/passwd", stat.S_IFLNK | 0o777),
    "metadata of 300 MB": bomb("cable-policy.json"),
    "weights of 300 MB": bomb("policy.pth"),
    "a bomb within the weights": inner_bomb,
    "metadata no JSON": lambda e, d, w: zipped({**e, "cable-policy.json": b"{"}),
    "metadata no UTF-8": lambda e, d, w: zipped({**e, "cable-policy.json": b'{"name": "\xff"}'}),
    "metadata too deep": lambda e, d, w: zipped({**e, "cable-policy.json": b"[" * 100_000}),
    "metadata a list": meta(lambda d: [1, 2]),
    "metadata a text": meta(lambda d: "policy"),
    "another schema": put("schema", "cable-policy/9"),
    "schema a list": put("schema", [1]),
    "an unknown key": put("nonsense", 1),
    **{f"no {key}": meta(lambda d, key=key: d.pop(key) and None) for key in ("name", "env_id", "settings", "channels")},
    **{f"no {key}": meta(lambda d, key=key: (d.pop(key), None)[1]) for key in ("seed", "steps", "complete")},
    **{
        f"{key} is null": put(key, None) for key in ("name", "env_id", "seed", "steps", "channels", "settings", "curve")
    },
    **{f"{key} is a list": put(key, [1]) for key in ("name", "env_id", "seed", "steps", "settings", "versions")},
    "name empty": put("name", ""),
    "an unknown environment": put("env_id", "cable_envs/Nowhere-v0"),
    "seed below 0": put("seed", -1),
    "seed of 400 digits": put("seed", 10**400),
    "steps a text": put("steps", "many"),
    "steps not finite": put("steps", float("nan")),
    "channels a text": put("channels", "reference"),
    "other channels": put("channels", ["reference"]),
    "channels numbers": put("channels", [1, 2]),
    "curve a number": put("curve", 3),
    "normalization a list": put("normalization", [1]),
    "normalization not finite": put(
        "normalization", {"mean": [float("nan")], "variance": [1.0], "clip": 1.0, "epsilon": 1e-8}
    ),
    "normalization too short": put("normalization", {"mean": [0.0], "variance": [1.0], "clip": 1.0, "epsilon": 1e-8}),
    "an unknown setting": put("settings.nonsense", 1),
    "no algorithm": meta(lambda d: (d["settings"].pop("algo"), None)[1]),
    "an unknown algorithm": put("settings.algo", "nonsense"),
    "an unknown network": put("settings.policy", "NonsensePolicy"),
    "a network of images": put("settings.policy", "CnnPolicy"),
    "net_arch a text": put("settings.policy_kwargs", {"net_arch": "wide"}),
    "net_arch negative": put("settings.policy_kwargs", {"net_arch": [-8]}),
    "net_arch gigantic": put("settings.policy_kwargs", {"net_arch": [10**9]}),
    "net_arch endless": put("settings.policy_kwargs", {"net_arch": [64] * 1000}),
    "unknown arguments": put("settings.policy_kwargs", {"nonsense": 1}),
    "a class as argument": put("settings.policy_kwargs", {"features_extractor_class": "os.system"}),
    "an unknown activation": put("settings.policy_kwargs", {"activation_fn": "os.system"}),
    "frame_stack gigantic": put("settings.frame_stack", 10**9),
    "frame_stack a text": put("settings.frame_stack", "4"),
    "an unknown base controller": put("settings.residual", {"controller": "nonsense", "share": 0.1}),
    "a residual without a share": put("settings.residual", {"nonsense": 0.1}),
    "options that are none": put("settings.env_options", {"observe": "nonsense"}),
    "options a list": put("settings.env_options", [1]),
    "other layers": put("settings.policy_kwargs", {"net_arch": [16]}),
    "weights a list": weighed(lambda w: list(w.values())),
    "weights a number": weighed(lambda w: 3.0),
    "weights none": weighed(lambda w: {}),
    "weights by number": weighed(lambda w: {3: torch.zeros(2)}),
    "weights with text": weighed(lambda w: {**w, "more": "text"}),
    "weights with a trap": weighed(lambda w: {**w, "more": Trap()}),
    "a trap as weights": lambda e, d, w: zipped({**e, "policy.pth": pickle.dumps(Trap())}),
    "weights of nonsense": lambda e, d, w: zipped({**e, "policy.pth": b"nonsense"}),
    "weights cut off": lambda e, d, w: zipped({**e, "policy.pth": e["policy.pth"][:-100]}),
    "a weight missing": weighed(lambda w: {k: v for k, v in list(w.items())[:-2] if "action_net" not in k}),
    "an unknown weight": weighed(lambda w: {**w, "nonsense": torch.zeros(2)}),
    "another shape": first(lambda t: torch.zeros(99)),
    "a shape without end": first(lambda t: torch.zeros(1).expand(2**20, 2**20)),
    "NaN": first(lambda t: t * float("nan")),
    "infinite": first(lambda t: t * float("inf") + float("inf")),
    "whole numbers": first(lambda t: t.to(torch.int64)),
    "complex numbers": first(lambda t: t.to(torch.complex64)),
    "sparse": first(lambda t: torch.eye(4).to_sparse()),
}


@pytest.mark.parametrize("what", WRONG)
def test_it_is_refused_in_one_line(whole, tmp_path, monkeypatch, what):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "theirs.zip"
    path.write_bytes(WRONG[what](*whole))
    with pytest.raises(ConfigurationError) as caught:
        load_policy(path)
    text = str(caught.value)
    assert "theirs.zip" in text and "\n" not in text and len(text) < 1000, text
    assert [p.name for p in tmp_path.iterdir()] == ["theirs.zip"]


def test_they_are_counted():
    assert len(WRONG) >= 80


def test_the_whole_one_is_read(whole, tmp_path):
    (tmp_path / "theirs.zip").write_bytes(zipped(whole[0]))
    assert load_policy(tmp_path / "theirs.zip").metadata.env_id == HOLE


FOREIGN = [
    "empty", "no zip", "a pickle", "truncated", "no weights", "weights twice", "a name that climbs", "a link",
    "weights of 300 MB", "a bomb within the weights", "weights a list", "weights with a trap", "a trap as weights",
    "another shape", "NaN", "sparse", "a shape without end", "encrypted", "a lying size",
]  # fmt: skip


@pytest.mark.parametrize("what", FOREIGN)
def test_so_is_one_of_stable_baselines3(whole, tmp_path, monkeypatch, what):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "theirs.zip"
    path.write_bytes(WRONG[what](*whole))
    with pytest.raises(ConfigurationError, match=r"theirs\.zip"):
        load_foreign(path, "ppo", HOLE, {}, {"net_arch": [8]})
    assert [p.name for p in tmp_path.iterdir()] == ["theirs.zip"]


@pytest.mark.parametrize("arguments", [{"net_arch": [10**9]}, {"net_arch": "wide"}, {"nonsense": 1}])
def test_arguments_of_a_foreign_network_are_bounded(whole, tmp_path, arguments):
    (tmp_path / "theirs.zip").write_bytes(zipped(whole[0]))
    with pytest.raises(ConfigurationError, match=r"theirs\.zip"):
        load_foreign(tmp_path / "theirs.zip", "ppo", HOLE, {}, arguments)

"""Kernels that an installation brings: the same numbers to the bit; compiled where they do not fit."""

import os
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import pytest
from numba.core.registry import cpu_target

from cable_envs.core.compiling.ahead import machine_code
from cable_envs.core.compiling.portable import PLAIN, written
from cable_envs.core.kernels import JIT_DISABLED, jit
from tests.support.counted import run
from tests.support.tree import ROOT

pytestmark = pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")

KERNEL = """
import hashlib
from pathlib import Path
import numpy as np
from cable_envs.core.compiling import ahead, portable
from cable_envs.core.kernels import exp, inline, jit, log

@inline
def _law(x, k):
    return exp(-k * x) * log(1.0 + x * x) + x / 3.0

@jit
def _inner(a, k, out):
    for i in range(a.shape[0]):
        out[i] = _law(a[i], k)

@jit
def curve(a, k, out):
    _inner(a, k, out)
    total = 0.0
    for i in range(a.shape[0]):
        total += out[i]
    return total

a = np.linspace(0.01, 20.0, 1001)
out = np.empty_like(a)
"""
WRITE = """
with portable.written(Path(sys.argv[1])) as files:
    curve(a, 0.37, out)
print(*(file.name for file in files))
"""
CALL = """
import logging
logging.basicConfig(level=logging.INFO, stream=sys.stdout)
ahead.BROUGHT = Path(sys.argv[1])
total = curve(a, 0.37, out)
print(hashlib.sha256(out.tobytes() + np.float64(total).tobytes()).hexdigest(), Count.compiled)
"""


def _called(cache: Path, brought: Path, **variables: str) -> tuple[str, bool]:
    """A digest of what the kernel gives, and whether it was compiled, which is said."""
    *said, last = run(KERNEL + CALL, cache, brought, **variables).splitlines()
    digest, count = last.split()
    assert any("compiling the equations" in line for line in said) == (int(count) > 0)
    return digest, int(count) > 0


@pytest.fixture(scope="module")
def brought(tmp_path_factory) -> Path:
    """A folder as an installation brings it, with one kernel."""
    folder = tmp_path_factory.mktemp("brought")
    (name,) = run(KERNEL + WRITE, folder.with_name("unused"), folder, **PLAIN).split()
    assert [file.name for file in folder.iterdir()] == [name]  # nothing of what it calls, and nothing is kept besides
    assert name.startswith("curve-")
    return folder


@pytest.fixture(scope="module")
def compiled(tmp_path_factory) -> str:
    """What the kernel gives, compiled from its source."""
    folder = tmp_path_factory.mktemp("compiled")
    digest, was_compiled = _called(folder, folder / "nothing")
    assert was_compiled
    return digest


@pytest.mark.slow
def test_bit_equal_without_compiling_and_kept(brought, compiled, tmp_path):
    assert _called(tmp_path, brought) == (compiled, False)
    assert _called(tmp_path, tmp_path / "nothing") == (compiled, False)  # as the first one left it


def test_on_a_plain_processor_where_nothing_can_be_written(brought, compiled, tmp_path):
    (tmp_path / "file").write_text("no folder")
    assert _called(tmp_path / "file", brought, **PLAIN) == (compiled, False)


def test_a_damaged_file_is_compiled(brought, compiled, tmp_path):
    (file,) = brought.iterdir()
    content = file.read_bytes()
    (tmp_path / file.name).write_bytes(content[:900] + b"\0\1" + content[902:])
    assert _called(tmp_path / "cache", tmp_path) == (compiled, True)


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:-9] + bytes(9)])
def test_a_damaged_file_is_seen(brought, damage, tmp_path):
    (file,) = brought.iterdir()
    (tmp_path / file.name).write_bytes(damage(file.read_bytes()))
    codegen = cpu_target.target_context.codegen()
    assert machine_code(file, codegen) is not None
    assert machine_code(tmp_path / file.name, codegen) is None
    assert machine_code(tmp_path / "nothing", codegen) is None


def _law(x, k):
    return k * x


@pytest.mark.parametrize("place", ["numba.__version__", "llvmlite.__version__", "sys.version_info"])
def test_other_versions_have_other_names(place, monkeypatch):
    name = jit(_law)._cache.name
    assert jit(_law)._cache.name == name
    with monkeypatch.context() as other:
        other.setattr(place, (3, 10, 0) if place == "sys.version_info" else "0.1")
        assert jit(_law)._cache.name != name


def test_kernels_for_others_are_not_written_for_this_processor(tmp_path):
    with written(tmp_path), pytest.raises(RuntimeError, match="NUMBA_CPU_NAME"):
        jit(lambda x: 2.5 * x)(1.0)
    assert list(tmp_path.iterdir()) == []


ENVIRONMENTS = """
import hashlib
from pathlib import Path
import gymnasium, numpy as np, cable_envs
from cable_envs.core.compiling import ahead
ahead.BROUGHT = Path(sys.argv[1])
said = hashlib.sha256()
for options in ({"sensor_noise": True, "randomize": True}, {"effects": {"slack": {"length": 1e-3}}}):
    one = gymnasium.make("cable_envs/CableHole-Tension-Step-v0", **options)
    many = gymnasium.make_vec(one.spec.id, num_envs=70, vectorization_mode="vector_entry_point", **options)
    for made in (one, many):
        made.reset(seed=5)
        made.action_space.seed(5)
        for _ in range(50):
            seen = made.step(made.action_space.sample())
            said.update(seen[0].tobytes() + np.asarray(seen[1]).tobytes())
print(said.hexdigest(), Count.compiled)
"""
SHIPPED = """
from pathlib import Path
from cable_envs import shipped
from cable_envs.core.compiling.portable import written
with written(Path(sys.argv[1])):
    shipped.environments(["cable_envs/CableHole-Position-Sine-v0"])
"""


@pytest.mark.slow
def test_environments_of_a_wheel_compile_nothing_and_give_the_same_numbers(tmp_path):
    """Other options and another task than those that the kernels were written with."""
    folder = tmp_path / "kernels"
    folder.mkdir()
    run(SHIPPED, tmp_path / "unused", folder, **PLAIN)
    digest, count = run(ENVIRONMENTS, tmp_path / "one", folder).split()
    assert count == "0"
    assert run(ENVIRONMENTS, tmp_path / "other", tmp_path / "nothing").split()[0] == digest


def _wheel(out: Path, kernels: str | None) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out), str(ROOT)]
    others = {name: value for name, value in os.environ.items() if name != "CABLE_ENVS_KERNELS"}
    given = {} if kernels is None else {"CABLE_ENVS_KERNELS": kernels}
    return subprocess.run(command, capture_output=True, text=True, timeout=600, env=others | given)


@pytest.mark.slow
def test_a_wheel_has_the_kernels_that_it_is_given(brought, tmp_path):
    names = [file.name for file in brought.iterdir()]
    for kernels, expected in ((str(brought), names), (None, [])):
        done = _wheel(tmp_path / str(kernels is None), kernels)
        assert done.returncode == 0, done.stderr
        (wheel,) = (tmp_path / str(kernels is None)).glob("*-py3-none-any.whl")
        with zipfile.ZipFile(wheel) as archive:
            inside = [n for n in archive.namelist() if n.startswith("cable_envs/compiled/")]
            assert [Path(name).name for name in inside] == expected
            assert all(zlib.decompress(archive.read(name)) for name in inside)
    done = _wheel(tmp_path / "none", str(tmp_path))
    assert done.returncode != 0 and "no kernels there" in done.stderr

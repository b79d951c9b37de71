"""Kernels on disk are found by what they call: other processes compile nothing, an edit recompiles its callers only."""

import gc
import importlib
import inspect
import os
import subprocess
import sys
import textwrap
from collections import namedtuple
from pathlib import Path

import numba
import numpy as np
import pytest

from cable_envs.core.compiling.digests import Digests, NotStorable, names_read
from cable_envs.core.compiling.templates import instantiate
from cable_envs.core.kernels import JIT_DISABLED, inline, jit
from tests.support.counted import COUNTED, run
from tests.support.tree import ROOT

SCALE, OTHER = 2.0, 3.0


def _law(x):
    return SCALE * x


def _neighbour(x):
    return OTHER * x


law, neighbour = inline(_law), inline(_neighbour)


def total(a):
    """Sum of a law over an array."""
    out = 0.0
    for k in range(a.shape[0]):
        out += law(a[k])
    return out


def both(a):
    return total_kernel(a) + neighbour(a[0])


total_kernel = jit(total)
both_kernel = jit(both)


def test_instantiate_takes_other_values_at_any_depth():
    a = np.array([1.0, 2.0])
    assert both_kernel(a) == 9.0
    other = instantiate(both, "other", law=neighbour)
    assert (other(a), other.__name__) == (12.0, "other")
    assert instantiate(both_kernel, SCALE=10.0)(a) == 33.0  # read two calls below
    assert both_kernel(a) == 9.0  # the template is as it was


def test_instantiate_shares_what_is_the_same():
    made = instantiate(both, OTHER=1.0)
    function = getattr(made, "py_func", made)
    assert function.__globals__["total_kernel"] is total_kernel
    assert function.__globals__["neighbour"] is not neighbour


@pytest.mark.skipif(JIT_DISABLED, reason="there is nothing to find on disk")
class TestDigests:
    def of(self, function, **changes):
        made = instantiate(function, **changes) if changes else function
        return Digests().of(getattr(made, "py_func", made))

    def test_an_edit_reaches_callers_only(self):
        edited = inline(eval("lambda x: SCALE * x + 0.0", globals()))
        assert self.of(total, law=edited) != self.of(total)
        assert self.of(both, law=edited) != self.of(both)
        assert self.of(both, neighbour=edited) != self.of(both)
        assert self.of(total, neighbour=edited) == self.of(total)

    def test_numbers_and_fields_count(self):
        assert self.of(both, SCALE=2.5) != self.of(both)
        assert self.of(total, OTHER=2.5) == self.of(total)
        one, two = namedtuple("Pair", "a b"), namedtuple("Pair", "b a")
        made = [instantiate(eval("lambda: kind", {"kind": None}), kind=kind).py_func for kind in (one, two)]
        assert Digests().of(made[0]) != Digests().of(made[1])

    def test_words_and_places_do_not_count(self):
        space: dict = {"law": law}
        exec("\n\n\ndef total(a):\n    'Said otherwise.'" + _text(total).split('"""')[2], space)
        assert Digests().of(space["total"]) == self.of(total)

    def test_what_nobody_could_recognise_is_not_stored(self, tmp_path):
        made = instantiate(eval("lambda: thing", {"thing": None}), thing=object())
        with pytest.raises(NotStorable):
            Digests().of(made.py_func)
        assert made._cache.cache_path is None  # and it is compiled all the same

    def test_an_edited_effect_changes_the_kernels_that_call_it_and_no_others(self, monkeypatch):
        from cable_envs.effects import EFFECTS
        from cable_envs.plants import plant_for

        plants = [plant_for("cable_hole"), plant_for("pulley_circuit"), plant_for("linear_drive")]
        kernels = [plant.kernels[1] for plant in plants]
        before = [self.of(kernel.py_func) for kernel in kernels]
        seen = set()
        for name in EFFECTS:
            module = importlib.import_module(f"cable_envs.effects.{name}")
            for piece in (v for v in vars(module).values() if getattr(v, "__module__", "") == module.__name__):
                if not hasattr(piece, "py_func"):
                    continue
                calls = [piece in _pieces(kernel) for kernel in kernels]
                code = piece.py_func.__code__
                with monkeypatch.context() as edit:
                    edit.setattr(piece.py_func, "__code__", code.replace(co_consts=(*code.co_consts, 12.5)))
                    after = [self.of(kernel.py_func) for kernel in kernels]
                assert [a != b for a, b in zip(after, before, strict=True)] == calls, (name, piece)
                seen.update(calls)
        assert seen == {True, False}


def _text(function) -> str:
    return inspect.getsource(function)


def _pieces(kernel, found=None):
    found = set() if found is None else found
    for value in map(kernel.py_func.__globals__.get, names_read(kernel.py_func.__code__)):
        if hasattr(value, "py_func") and value not in found:
            found.add(value)
            _pieces(value, found)
    return found


ENVIRONMENT = """
import gymnasium, cable_envs
env = gymnasium.make("cable_envs/PulleyCircuit-Position-Sine-v0", **eval(sys.argv[1]))
env.reset(seed=1)
for _ in range(3): obs = env.step(env.action_space.sample() * 0)[0]
print(Count.compiled, obs.tobytes().hex())
"""


@pytest.mark.slow
@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
@pytest.mark.parametrize("own", [False, True], ids=["", "with an own effect"])
def test_a_second_process_compiles_nothing(own, tmp_path):
    options: dict = {}
    if own:
        from tests.effects.test_own_effects import SPRING

        (tmp_path / "spring.py").write_text(SPRING)
        options = {"effect_file": str(tmp_path / "spring.py"), "effects": {"cubic_spring": {"cubic": 50.0}}}
    first = run(ENVIRONMENT, tmp_path / "cache", repr(options)).split()
    again = run(ENVIRONMENT, tmp_path / "cache", repr(options)).split()
    assert int(first[0]) > 0
    assert again == ["0", first[1]]


SMALL = """
from cable_envs.core.compiling import cache
from cable_envs.sim.references import evaluate
import numba
import numpy as np
print(evaluate(np.zeros((8, 1)), 0.5)[0, 0], Count.compiled, evaluate._cache.cache_path)
"""


NAMED = """
from cable_envs.core.kernels import jit
from cable_envs.core.lanes import Lanes
import numba
import numpy as np
mass = Lanes("Mass", ["speed", "force"])

@jit
def push(x):
    x.speed[0] += x.force[0]

x = mass.over(np.ones((2, 1)))
loads = [0]
found = push._cache.load_overload
def counted(*args):
    loads[0] += 1
    return found(*args)
push._cache.load_overload = counted
for _ in range(5):
    push(x)
print(x.speed[0], loads[0], Count.compiled)
"""


@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_a_kernel_on_named_rows_is_loaded_once(tmp_path):
    """The class of a named tuple does not survive a file: calls after the first must find what was loaded."""
    assert run(NAMED, tmp_path / "cache").split() == ["6.0", "1", "1"]
    assert run(NAMED, tmp_path / "cache").split() == ["6.0", "1", "0"]


@pytest.mark.slow
@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_old_versions_are_deleted(tmp_path):
    day = 86_400.0
    root = tmp_path / "kernels"
    for name, days in (("evaluate-0a", 2.0), ("evaluate-0b", 0.5), ("other-0c", 2.0), ("other-0d", 40.0)):
        (root / name).mkdir(parents=True)
        then = (root / name).stat().st_mtime - days * day
        os.utime(root / name, (then, then))
    *_, path = run(SMALL, tmp_path).split()
    assert sorted(p.name for p in root.iterdir()) == sorted(["evaluate-0b", "other-0c", Path(path).name])


@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_where_nothing_can_be_written_kernels_are_compiled(tmp_path):
    (tmp_path / "file").write_text("no folder")
    value, compiled, path = run(SMALL, tmp_path / "file").split()
    assert (value, path) == ("0.0", "None")
    assert int(compiled) > 0


@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_a_broken_file_is_compiled_again(tmp_path):
    *_, path = run(SMALL, tmp_path).split()
    (stored,) = Path(path).iterdir()
    stored.write_bytes(stored.read_bytes()[:100])
    value, compiled, _ = run(SMALL, tmp_path).split()
    assert value == "0.0" and int(compiled) > 0
    assert run(SMALL, tmp_path).split()[1] == "0"


@pytest.mark.slow
@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_processes_at_the_same_time(tmp_path):
    """Three processes compile and store the same kernel; each result is right, and one file is left."""
    code = COUNTED + textwrap.dedent(SMALL)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    running = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(3)
    ]
    said = [process.communicate(timeout=300)[0].split() for process in running]
    assert [words[0] for words in said] == ["0.0"] * 3
    assert len(list(Path(said[0][2]).iterdir())) == 1


LAW = """
from pathlib import Path
import sys
import numba
import numpy as np
from cable_envs.core.compiling import cache
from cable_envs.core.kernels import jit

cache._PACKAGE = Path(sys.argv[1])  # an installation that cannot be written to
sys.path.insert(0, sys.argv[2])
import shared_law
print(shared_law.law(np.ones(3)), shared_law.law._cache.cache_path)
"""


@pytest.mark.slow
@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_an_updated_installation_that_nobody_can_write_to_runs_its_new_kernels(tmp_path):
    """The same path, name, size and date, another number in the source: both processes get the new kernel."""
    package, place = tmp_path / "package", tmp_path / "place"
    package.write_text("stands where a folder would be made")
    place.mkdir()

    def installed(number):
        (place / "shared_law.py").write_text(
            f"from cable_envs.core.kernels import jit\n\n\n@jit\ndef law(a):\n    return {number} * a[0]\n"
        )
        os.utime(place / "shared_law.py", (1e9, 1e9))

    def running(home):
        kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        environment = {**kept, "XDG_CACHE_HOME": str(home), "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
        words = [sys.executable, "-c", LAW, str(package), str(place)]
        return subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment)

    for number in ("2.0", "3.0", "2.0"):
        installed(number)
        both = [running(tmp_path / "home") for _ in range(2)]  # two at once into one folder
        said = [process.communicate(timeout=300)[0].split() for process in both]
        assert [words[0] for words in said] == [number, number]
        assert all(words[1].startswith(str(tmp_path / "home")) for words in said)
    folders = list((tmp_path / "home").rglob("law-*"))
    assert len(folders) == 2 and all(len(list(folder.iterdir())) == 1 for folder in folders)


@pytest.mark.skipif(JIT_DISABLED, reason="nothing is compiled")
def test_a_compilation_is_not_searched_for_garbage_and_the_collector_goes_on_after_it():
    searched = []

    def seen(phase, info):
        searched.append(phase)

    good, wrong = jit(lambda a: law(a) + 0.5), jit(lambda a: no_such_name + a)  # noqa: F821
    good._cache.disable()
    gc.callbacks.append(seen)
    try:
        gc.collect()
        good.compile((numba.float64,))
        assert searched == ["start", "stop"]  # of the one that is asked for here
    finally:
        gc.callbacks.remove(seen)
    with pytest.raises(numba.TypingError, match="no_such_name"):
        wrong(1.0)
    assert gc.isenabled()

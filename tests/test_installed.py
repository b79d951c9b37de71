"""The wheel as others install it: beside distributions that own common names, in folders that cannot be written."""

import base64
import hashlib
import subprocess
import sys
import zipfile
from importlib.metadata import Distribution, distributions
from pathlib import Path

import pytest

from tests.support.tree import ROOT

COMMON = ("agents", "baselines", "configs", "diagnosis", "identification", "proof", "reproduction", "tests")
"""Names that are folders of this project and that another distribution may install."""

REAL = {"openai-agents": ("openai-agents==0.24.0", "agents")}
"""Distribution: what is installed, and its import name."""


def _pip(*arguments: str | Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


@pytest.fixture(scope="module")
def ours(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    done = _pip("wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT)
    assert done.returncode == 0, done.stderr
    return next(folder.glob("cable_envs-*.whl"))


@pytest.fixture(scope="module")
def stranger(tmp_path_factory) -> Path:
    """A distribution that installs every common name."""
    files = {f"{name}/__init__.py": f"OWNER = 'stranger'  # {name}\n".encode() for name in COMMON}
    about = "stranger-1.0.dist-info"
    files[f"{about}/METADATA"] = b"Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n"
    files[f"{about}/WHEEL"] = b"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    digests = {n: base64.urlsafe_b64encode(hashlib.sha256(c).digest()).rstrip(b"=").decode() for n, c in files.items()}
    record = "".join(f"{n},sha256={digests[n]},{len(c)}\n" for n, c in files.items()) + f"{about}/RECORD,,\n"
    path = tmp_path_factory.mktemp("stranger") / "stranger-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in {**files, f"{about}/RECORD": record.encode()}.items():
            archive.writestr(name, content)
    return path


@pytest.fixture
def environment(tmp_path) -> Path:
    """The Python of a virtual environment with nothing in it."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True, timeout=120)
    return tmp_path / "venv" / "bin" / "python"


def _distribution(python: Path, name: str) -> Distribution:
    site = next(python.parents[1].glob("lib/python*/site-packages"))
    return next(d for d in distributions(path=[str(site)]) if d.metadata["Name"] == name)


def _broken(found: Distribution) -> list[str]:
    """Files of a distribution that are not there, or are not what its record says."""
    wrong = []
    for file in found.files or ():
        place = Path(file.locate())
        if not place.is_file():
            wrong.append(f"{file}: gone")
        elif file.hash is not None:
            digest = hashlib.new(file.hash.mode, place.read_bytes()).digest()
            if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != file.hash.value:
                wrong.append(f"{file}: overwritten")
    return wrong


@pytest.mark.slow
@pytest.mark.parametrize("first", ["cable-envs", "other"])
@pytest.mark.parametrize("other", ["stranger", *REAL])
def test_no_import_name_is_another_distributions(ours, stranger, environment, other, first):
    """Installed in either order both are whole, and either's removal leaves the other whole."""
    wanted, name = (stranger, "agents") if other == "stranger" else REAL[other]
    for wheel in (ours, wanted) if first == "cable-envs" else (wanted, ours):
        done = _pip("--python", environment, "install", "--quiet", "--no-deps", wheel)
        if done.returncode and wheel == wanted and other in REAL:
            pytest.skip(f"{other} cannot be had: {done.stderr.strip().splitlines()[-1]}")
        assert done.returncode == 0, done.stderr
    both = [_distribution(environment, found) for found in ("cable-envs", other)]
    assert not {str(f) for f in both[0].files} & {str(f) for f in both[1].files}
    assert [_broken(found) for found in both] == [[], []]
    origin = subprocess.run(
        [environment, "-P", "-c", f"from importlib.util import find_spec; print(find_spec('{name}').origin)"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    assert origin in {str(f.locate()) for f in both[1].files}
    for gone, stays in (("cable-envs", other), (other, "cable-envs")) if first == "other" else ((other, "cable-envs"),):
        done = _pip("--python", environment, "uninstall", "--quiet", "--yes", gone)
        assert done.returncode == 0, done.stderr
        assert _broken(_distribution(environment, stays)) == []
        _pip("--python", environment, "install", "--quiet", "--no-deps", ours if gone == "cable-envs" else wanted)

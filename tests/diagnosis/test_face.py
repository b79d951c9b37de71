"""What the package offers by its own name."""

import subprocess
import sys

import pytest

from cable_envs import diagnosis


def test_public_names_are_those_of_the_modules_behind_them():
    from cable_envs.diagnosis.data.recording import Recording, load_recording
    from cable_envs.diagnosis.engine import diagnose
    from cable_envs.diagnosis.model.verdict import Diagnosis

    assert (diagnosis.diagnose, diagnosis.Diagnosis) == (diagnose, Diagnosis)
    assert (diagnosis.load_recording, diagnosis.Recording) == (load_recording, Recording)
    assert set(diagnosis.__all__) <= set(dir(diagnosis))
    with pytest.raises(AttributeError, match=r"'cable_envs\.diagnosis' has no attribute 'diagnos'"):
        _ = diagnosis.diagnos


def test_importing_the_package_loads_no_kernel():
    code = "import sys, cable_envs.diagnosis; assert not {'numba', 'scipy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)

"""What holds for all tests."""

import gc
import logging
import os
from pathlib import Path

import pytest

# kernels are kept where the package keeps them, also those that a copy of it compiles in a process of its own: they are
# filed by content
os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(__file__).parents[1] / "cable_envs" / "__pycache__"))

# what is printed must not depend on which kernels this machine has compiled before
logging.getLogger("cable_envs").setLevel(logging.WARNING)


def pytest_collection_finish(session):
    """What was imported and collected stays: the garbage collector need not look at it again for each test."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _no_memory_of_the_user(tmp_path_factory):
    """What was agreed to on the command line is neither read from the user's file nor written there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        yield

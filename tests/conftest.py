"""What holds for all tests."""

import logging

import pytest

# what is printed must not depend on which kernels this machine has compiled before
logging.getLogger("cable_envs").setLevel(logging.WARNING)


@pytest.fixture(scope="session", autouse=True)
def _no_memory_of_the_user(tmp_path_factory):
    """What was agreed to on the command line is neither read from the user's file nor written there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        yield

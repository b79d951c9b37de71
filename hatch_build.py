"""A wheel brings the kernels that lie in the folder which the variable CABLE_ENVS_KERNELS names (`make wheel`)."""

import os
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Kernels(BuildHookInterface):
    """Without the variable, and for an editable installation, nothing is added."""

    PLUGIN_NAME = "custom"

    def initialize(self, version, build_data):
        """Put the folder's files where `cable_envs.core.compiling.ahead` looks for them."""
        asked = os.environ.get("CABLE_ENVS_KERNELS")
        if not asked or version == "editable":
            return
        found = sorted(Path(self.root, asked).glob("*.bc"))
        if not found:
            raise FileNotFoundError(f"CABLE_ENVS_KERNELS={asked}: no kernels there; `make wheel` writes them first")
        build_data["force_include"].update({str(file): f"cable_envs/compiled/{file.name}" for file in found})

"""Write the kernels that are called as LLVM bitcode which knows no processor, for a wheel to bring.

numba compiles each piece of a kernel by itself, up to vector code, and puts the results together. Here the pieces are
merged as they were written, and nothing else is done to them: loops become vector code on the machine that the kernel
will run on (`cable_envs.core.compiling.ahead`).
"""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from numba.core.codegen import JITCodeLibrary
from numba.core.serialize import dumps

from cable_envs.core.compiling import ahead
from cable_envs.core.compiling.cache import KernelCache, is_storable

PLAIN = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
"""Environment variables that a process which writes kernels must be started with: numba reads them when imported."""


@contextmanager
def written(folder: Path) -> Iterator[list[Path]]:
    """Within it, every kernel that Python calls for the first time is compiled anew and written to a folder.

    Parameters
    ----------
    folder : Path
        It must be there.

    Yields
    ------
    list of Path
        The files, as they come into being.
    """
    files: list[Path] = []
    depth = 0

    def load_overload(cache: KernelCache, sig: Any, target_context: Any) -> None:
        nonlocal depth
        cache.name  # noqa: B018 - names everything by its content
        target_context.refresh()
        if target_context.codegen().magic_tuple()[1:] != tuple(PLAIN.values()):
            raise RuntimeError(f"kernels for others are written in a process with the variables {PLAIN}")
        depth += 1

    def save_overload(cache: KernelCache, sig: Any, data: Any) -> None:
        nonlocal depth
        depth -= 1
        if depth == 0 and cache.name is not None and is_storable(data):  # others are within one that Python calls
            (name, *_), *rest = data._reduce()
            rest[5] = ""  # the annotation of types, for people, with paths of this machine
            file = ahead.file_of(cache.name, sig, data.codegen, folder)
            file.write_bytes(zlib.compress(dumps(((name, data.library.merged), *rest)), 9))
            files.append(file)

    with (
        patch.object(JITCodeLibrary, "_optimize_final_module", _merge),
        patch.object(KernelCache, "load_overload", load_overload),
        patch.object(KernelCache, "save_overload", save_overload),
    ):
        yield files


def _merge(library: Any) -> None:
    """Take the pieces that are called into their callers, as numba's first passes do, and keep what comes of it."""
    passes, builder = library._codegen._module_pass_manager(
        loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
    )
    passes.add_global_dead_code_eliminate_pass()
    passes.run(library._final_module, builder)
    library.merged = library._final_module.as_bitcode()

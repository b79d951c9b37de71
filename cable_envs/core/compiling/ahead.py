"""Kernels that an installation brings, compiled up to the point where the processor begins to matter.

What takes most of the time of compiling is the same on every machine: finding the types, writing LLVM's code of every
piece, and putting the pieces into one. A wheel may bring the result of that as LLVM bitcode
(`cable_envs.core.compiling.portable` writes it). The rest, from numba's own optimisation to machine code for the
processor at hand, is done here at the first call and then kept as if it had been compiled. No step of it may change the
rounding of a number, so that the results are those of a kernel compiled from its source, to the bit.

A file is found under the kernel's digest, which has the versions of Python, numba and llvmlite in it, and under
signature and platform. Where one of these is another there is no such file, and the kernel is compiled.
"""

import hashlib
import pickle
import zlib
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

BROUGHT = Path(__file__).parents[2] / "compiled"
"""The folder of an installation in which they are; a checkout has none. Nothing is read from anywhere else."""


def file_of(kernel: str, sig: Any, codegen: Any, folder: Path | None = None) -> Path:
    """Where the bitcode of a kernel for a signature is, if it is anywhere.

    Parameters
    ----------
    kernel : str
        What the kernel is filed under (`cable_envs.core.compiling.cache.KernelCache.name`).
    sig : tuple or Signature
        Types of the arguments.
    codegen : numba's code generator
        Of the platform.
    folder : Path, optional
        By default `BROUGHT`.
    """
    platform = codegen.magic_tuple()[0]
    key = hashlib.sha256(repr((sig, platform)).encode()).hexdigest()
    return (BROUGHT if folder is None else folder) / f"{kernel}-{key[:16]}.bc"


def machine_code(file: Path, codegen: Any) -> tuple | None:
    """What numba rebuilds a compiled function from, with machine code for this processor.

    Parameters
    ----------
    file : Path
        As `file_of` gives it.
    codegen : numba's code generator
        Of this processor.

    Returns
    -------
    tuple or None
        None where there is no such file, or a damaged one.
    """
    try:
        (name, bitcode), *rest = pickle.loads(zlib.decompress(file.read_bytes()))
    except (OSError, zlib.error):  # the checksum of zlib tells a damaged file
        return None
    library = codegen.create_library(name)
    library._final_module = module = llvm.parse_bitcode(bitcode)
    library._optimize_final_module()
    code = codegen._tm.emit_object(module)
    for function in module.functions:
        if not function.is_declaration and function.linkage == llvm.Linkage.external:
            function.linkage = "linkonce_odr"  # as numba keeps what other kernels may take pieces from
    return (name, "object", (code, module.as_bitcode())), *rest

"""Compilation of C functions with cffi, cached in the folder of the kernels of UFL forms."""

from __future__ import annotations

import hashlib
import importlib.util
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.checks.errors import on_rank_zero
from gossamer_fx.forms.compilation import kernel_options

# C types by the type characters of NumPy.
KINDS = {"d": "double[]", "i": "int32_t[]", "B": "uint8_t[]"}

# Hexadecimal digits of a module's hash: 64 bits keep different sources apart in one folder.
HASH_DIGITS = 16


def compile_c(comm: MPI.Intracomm, name: str, declarations: str, source: str) -> Any:
    """Compile a C source, or load it from the cache, and return it as a Python module.

    The module has the functions in `.lib` and the types in `.ffi`.  Collective.

    Args:
        comm: the ranks; rank 0 compiles while the others wait.
        name: part of the module's name, for people who look into the cache.
        declarations: prototypes of the functions that are called from Python, in cffi's syntax.
        source: the C source.

    Raises:
        RuntimeError: the compiler refuses the source, or the file in the cache is damaged.

    >>> from mpi4py import MPI
    >>> twice = "double twice(double x)"
    >>> module = compile_c(MPI.COMM_SELF, "twice", twice + ";", twice + " { return 2 * x; }")
    >>> module.lib.twice(3.0)
    6.0
    """
    options = kernel_options()
    arguments = [
        *options["cffi_extra_compile_args"],
        "-O3",
        # Without it sqrt() is a call that sets errno, and loops with it are not vectorised.
        "-fno-math-errno",
        # No fused multiply-add: processors without that instruction round the product and the sum
        # separately.  The last digits of a result are then the same on all processors.
        "-ffp-contract=off",
    ]
    # All on which the machine code depends; the version of Python, because cffi links against it.
    ingredients = [declarations, source, *arguments, sys.version]
    digest = hashlib.sha1("\n".join(ingredients).encode()).hexdigest()
    module = f"gossamer_{name}_{digest[:HASH_DIGITS]}"
    folder = Path(options["cache_dir"])
    path = folder / f"{module}.so"

    def build() -> None:
        if path.exists():
            return
        import cffi

        folder.mkdir(parents=True, exist_ok=True)
        ffi = cffi.FFI()
        ffi.cdef(declarations)
        ffi.set_source(module, source, extra_compile_args=arguments)
        # Two runs may compile at the same time: each does so in its own folder, and moves the
        # complete file to its final name at once.
        with tempfile.TemporaryDirectory(dir=folder) as work:
            compiled = Path(ffi.compile(tmpdir=work))
            part = folder / f".{module}.{Path(work).name}"
            shutil.copy(compiled, part)
            part.rename(path)

    on_rank_zero(comm, build)
    specification = importlib.util.spec_from_file_location(module, path)
    if specification is None or specification.loader is None:
        raise RuntimeError(f"'{path}' is not a compiled module; remove it.")
    loaded = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(loaded)
    return loaded


def pointers(ffi: Any, *arrays: npt.NDArray[Any] | None) -> list[Any]:
    """Convert arrays to pointers, as arguments of a C function that `compile_c` has compiled.

    Args:
        ffi: the types of the compiled module, `module.ffi`.
        arrays: contiguous arrays of float64, int32 or uint8; None becomes a null pointer.

    Raises:
        KeyError: an array has another type.
    """
    result = []
    for array in arrays:
        if array is None:
            result.append(ffi.NULL)
        else:
            result.append(ffi.from_buffer(KINDS[array.dtype.char], array))
    return result

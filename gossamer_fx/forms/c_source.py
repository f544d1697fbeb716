"""Compilation of C functions: once a machine, into the folder of the forms' kernels."""

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

KINDS = {"d": "double[]", "i": "int32_t[]", "B": "uint8_t[]"}  # by NumPy's characters


def compile_c(comm: MPI.Intracomm, name: str, declarations: str, source: str) -> Any:
    """A module with the functions of a C source (`.lib`) and its types (`.ffi`), compiled or taken from the cache.

    It is compiled in a folder of its own and moved when it is complete: two runs may do so at the same time.

    Args:
        comm: rank 0 compiles for all, who wait.
        declarations: of the functions to be called, as cffi reads them.

    Raises:
        RuntimeError: the compiler's words.
    """
    options = kernel_options()
    # Without contraction the compiler makes no fused multiply-add of a product and a sum, which processors without
    # that instruction would round twice: the last digits of a result are then the same on all of them.
    arguments = [*options["cffi_extra_compile_args"], "-O3", "-fno-math-errno", "-ffp-contract=off"]
    key = hashlib.sha1(
        "\n".join([declarations, source, *arguments, sys.version]).encode()
    ).hexdigest()[:16]
    module, folder = f"gossamer_{name}_{key}", Path(options["cache_dir"])
    path = folder / f"{module}.so"

    def build() -> None:
        if path.exists():
            return
        import cffi

        folder.mkdir(parents=True, exist_ok=True)
        ffi = cffi.FFI()
        ffi.cdef(declarations)
        ffi.set_source(module, source, extra_compile_args=arguments)
        with tempfile.TemporaryDirectory(dir=folder) as work:
            compiled = Path(ffi.compile(tmpdir=work))
            part = folder / f".{module}.{Path(work).name}"
            shutil.copy(compiled, part)
            part.rename(path)

    on_rank_zero(comm, build)
    specification = importlib.util.spec_from_file_location(module, path)
    if specification is None or specification.loader is None:
        raise RuntimeError(f"'{path}' is no compiled module; remove it.")
    loaded = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(loaded)
    return loaded


def pointers(ffi: Any, *arrays: npt.NDArray[Any] | None) -> list[Any]:
    """Contiguous arrays as arguments of a C function; None is a null pointer."""
    return [ffi.NULL if a is None else ffi.from_buffer(KINDS[a.dtype.char], a) for a in arrays]

"""C functions of the package: compiled once on a machine, and called with arrays that were checked.

A library is a folder of C files and one header with the functions and structures that Python uses.
The C compiler and cffi read the same header, so that no prototype is written twice.  cffi does not
know the preprocessor: what it is given are the header's lines that do not begin with `#`.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.errors import on_rank_zero
from gossamer_fx.core.forms.backend import KERNELS_TAKE_DATA
from gossamer_fx.core.forms.compilation import kernel_options, private_cache, require_compiler

# Names of C's types of array elements, by NumPy's.
C_TYPES = {"float64": "double", "int32": "int32_t", "int64": "int64_t", "uint8": "uint8_t"}
# The same types as NumPy compares them: contact hands over some seventy arrays an iteration, and
# the name of a type is composed again at each request for it.
NUMPY_TYPES = {name: np.dtype(name) for name in C_TYPES}
# How the arrays are declared to cffi.
ARRAY_TYPES = {name: f"{c_type}[]" for name, c_type in C_TYPES.items()}

OPTIMISATION = (
    "-O3",
    # Without it sqrt() is a call that sets errno, and loops with it are not vectorised.
    "-fno-math-errno",
    # No fused multiply-add: processors without that instruction round the product and the sum
    # separately.  The last digits of a result are then the same on all processors.
    "-ffp-contract=off",
)

# Hexadecimal digits of a module's hash: 64 bits keep different sources apart in one folder.
HASH_DIGITS = 16

# Further compiler options, for instance "-fsanitize=address,undefined -g" in the job that looks for
# errors of memory.
FLAGS_VARIABLE = "GOSSAMER_CFLAGS"


@dataclass(frozen=True)
class CLibrary:
    """Compiled C functions (`lib`), and what converts between Python and C (`ffi`), both of
    cffi."""

    lib: Any
    ffi: Any

    def array(
        self,
        name: str,
        values: npt.NDArray[Any] | None,
        dtype: str,
        shape: tuple[int, ...],
        *,
        writable: bool = False,
    ) -> Any:
        """Return an array, which C reads or writes without a copy, as a C pointer that lives as
        long as it is kept; None is the null pointer.

        An array that is not contiguous, not of the type ("float64", "int32", "int64" or "uint8")
        and shape that are given, or read-only although C writes into it, raises `ValueError` with
        its name.
        """
        if values is None:
            return self.ffi.NULL
        if values.dtype != NUMPY_TYPES[dtype]:
            raise _unsuitable(f"{name} is of type {values.dtype.name}", dtype, shape)
        if values.shape != shape:
            raise _unsuitable(f"{name} has the shape {values.shape}", dtype, shape)
        if not values.flags.c_contiguous:
            raise _unsuitable(f"{name} is not contiguous", dtype, shape)
        if writable and not values.flags.writeable:
            raise _unsuitable(f"{name} is read-only, and C writes into it", dtype, shape)
        return self.ffi.from_buffer(ARRAY_TYPES[dtype], values, require_writable=writable)

    def struct(self, type_name: str, fields: Mapping[str, Any]) -> CStruct:
        """Return a new C structure with values for all of its fields."""
        return CStruct(self.ffi, type_name, fields)


class CStruct:
    """A C structure that keeps alive the arrays to which its fields point; `pointer` is what C
    functions take."""

    def __init__(self, ffi: Any, type_name: str, fields: Mapping[str, Any]) -> None:
        """Set all fields of a new structure: numbers, pointers, or the fields of an inner
        structure.  A missing or unknown field raises `ValueError`."""
        known = _field_names(ffi, type_name)
        if known != fields.keys():
            raise ValueError(
                f"The fields of {type_name} are {sorted(known)}, given are {sorted(fields)}."
            )
        self._kept = fields
        self.pointer = ffi.new(f"{type_name} *", fields)


@functools.cache
def _field_names(ffi: Any, type_name: str) -> frozenset[str]:
    """Names of the fields of a C structure."""
    return frozenset(name for name, _ in ffi.typeof(type_name).fields)


def _unsuitable(problem: str, dtype: str, shape: tuple[int, ...]) -> ValueError:
    """The error of an array that C cannot take."""
    return ValueError(f"{problem}; give a contiguous array of {dtype} with the shape {shape}.")


def check_indices(name: str, indices: npt.NDArray[np.integer], count: int) -> None:
    """Raise `ValueError`, about `name` in the plural, unless all indices are from 0 to count - 1; C
    functions do not look."""
    if not indices.size:
        return
    least = int(indices.min())
    greatest = int(indices.max())
    if least < 0 or greatest >= count:
        raise ValueError(f"{name} are from {least} to {greatest}; give 0 to {count - 1}.")


def declarations_of(header: Path) -> str:
    """Return the declarations of a header, and of those of the package that it includes, as cffi
    reads them: all lines but the preprocessor's."""
    lines = []
    for line in header.read_text(encoding="utf-8").splitlines():
        if line.startswith('#include "'):
            lines.append(declarations_of(header.parent / line.split('"')[1]))
        elif not line.startswith("#"):
            lines.append(line)
    return "\n".join(lines)


# Libraries of this process, by their headers: each is loaded once.
_loaded: dict[Path, CLibrary] = {}


def c_library(header: Path, comm: MPI.Intracomm = MPI.COMM_SELF) -> CLibrary:
    """Return the C functions that a header declares, of all C files in its folder.

    Collective: rank 0 of `comm` compiles the files, or finds them in the cache of kernels, and the
    others wait.  Without a C compiler it raises `InputError`; if the
    compiler refuses the files, `cffi.VerificationError`, on other ranks `RuntimeError`.
    """
    # A rank may have loaded a library that others have not, for a separate mesh.
    if comm.allreduce(header not in _loaded, op=MPI.LOR):
        _loaded[header] = _load(header, comm)
    return _loaded[header]


def _load(header: Path, comm: MPI.Intracomm) -> CLibrary:
    """Compile the C files next to a header, unless the cache has them, and load them.
    Collective."""
    options = kernel_options()
    arguments = [*options["cffi_extra_compile_args"], *OPTIMISATION]
    if KERNELS_TAKE_DATA:
        arguments.append("-DKERNELS_TAKE_DATA")
    arguments += shlex.split(os.environ.get(FLAGS_VARIABLE, ""))
    # All on which the machine code depends; the version of Python, because cffi links against it.
    # Files of other folders may include those of this one.
    paths = {*header.parent.glob("*.[ch]"), *Path(__file__).parent.glob("*.[ch]")}
    texts = [path.read_text(encoding="utf-8") for path in sorted(paths)]
    digest = hashlib.sha1("\n".join([*texts, *arguments, sys.version]).encode()).hexdigest()
    module = f"gossamer_{header.stem}_{digest[:HASH_DIGITS]}"
    path = Path(options["cache_dir"]) / f"{module}.so"

    def build() -> None:
        private_cache()
        if not path.exists():
            _build(module, path, header, arguments)

    on_rank_zero(comm, build)
    specification = importlib.util.spec_from_file_location(module, path)
    if specification is None or specification.loader is None:
        raise RuntimeError(f"'{path}' is not a compiled module; remove it.")
    loaded = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(loaded)
    return CLibrary(loaded.lib, loaded.ffi)


def _build(module: str, path: Path, header: Path, arguments: Sequence[str]) -> None:
    """Compile a module in a separate folder, and rename it when it is complete: two runs may
    compile the same library at the same time, and neither sees half a file."""
    require_compiler()
    import cffi

    path.parent.mkdir(parents=True, exist_ok=True)
    ffi = cffi.FFI()
    ffi.cdef(declarations_of(header))
    ffi.set_source(
        module,
        f'#include "{header.name}"',
        sources=[str(path) for path in sorted(header.parent.glob("*.c"))],
        include_dirs=[str(header.parent)],
        extra_compile_args=list(arguments),
        extra_link_args=[option for option in arguments if option.startswith("-fsanitize")],
    )
    with tempfile.TemporaryDirectory(dir=path.parent) as work:
        compiled = Path(ffi.compile(tmpdir=work))
        unfinished = path.parent / f".{module}.{Path(work).name}"
        shutil.copy(compiled, unfinished)
        unfinished.rename(path)

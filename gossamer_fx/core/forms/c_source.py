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
from gossamer_fx.core.forms.compilation import kernel_options, private_cache
from gossamer_fx.core.forms.compiler import require_compiler

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
        """Return an array as a C pointer, which lives as long as it is kept; None is the null
        pointer.

        Args:
            name: what it is called in messages.
            values: array that C reads or writes without a copy, or None.
            dtype: "float64", "int32", "int64" or "uint8".
            shape: the one it must have.
            writable: whether C writes into it.

        Raises:
            ValueError: another type or shape, not contiguous, or not writable.
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
    """A C structure that keeps alive the arrays to which its fields point.

    Attributes:
        pointer: to be handed to a C function.
    """

    def __init__(self, ffi: Any, type_name: str, fields: Mapping[str, Any]) -> None:
        """Set all fields of a new structure.

        Args:
            ffi: cffi's interface of the library.
            type_name: of the structure in the C header.
            fields: a value for each of its fields: numbers, pointers, or the fields of an inner
                structure.

        Raises:
            ValueError: a field is missing or unknown.
        """
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
    """Raise `ValueError` unless all indices are from 0 to count - 1; C functions do not look.

    Args:
        name: subject of the message, in the plural.
        indices: of any shape; none is right.
        count: of what they number.
    """
    if not indices.size:
        return
    least = int(indices.min())
    greatest = int(indices.max())
    if least < 0 or greatest >= count:
        raise ValueError(f"{name} are from {least} to {greatest}; give 0 to {count - 1}.")


def declarations_of(header: Path) -> str:
    """Return the declarations of a header as cffi reads them: all lines but the preprocessor's."""
    lines = header.read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if not line.startswith("#"))


# Libraries of this process, by their headers: each is loaded once.
_loaded: dict[Path, CLibrary] = {}


def loaded_library(
    comm: MPI.Intracomm,
    name: str,
    header: Path,
    sources: Sequence[str],
    definitions: Sequence[str] = (),
) -> CLibrary:
    """Return a library of C functions, which is compiled or loaded once in a process.

    The first call for a header is collective.

    Args:
        comm: rank 0 compiles, the others wait.
        name: of the library, for its file's name.
        header: C header with all functions and structures that Python uses; later calls use it
            alone.
        sources: names of the C files in the header's folder.
        definitions: names that are defined for the preprocessor.

    Raises:
        InputError: no C compiler was found.
        cffi.VerificationError: the compiler refuses the files; on other ranks than 0 a
            RuntimeError.
    """
    found = _loaded.get(header)
    if found is None:
        found = compile_library(comm, name, header, sources, definitions)
        _loaded[header] = found
    return found


def compile_library(
    comm: MPI.Intracomm,
    name: str,
    header: Path,
    sources: Sequence[str],
    definitions: Sequence[str] = (),
) -> CLibrary:
    """Compile C files into a library, or take it from the cache of kernels; collective.

    Args:
        comm: rank 0 compiles, the others wait.
        name: of the library, which becomes a part of its file's name.
        header: the file with all functions and structures that Python uses.
        sources: names of the C files in the header's folder.
        definitions: names that are defined for the preprocessor.

    Raises:
        InputError: no C compiler was found.
        cffi.VerificationError: the compiler refuses the files; on other ranks than 0 a
            RuntimeError.
        RuntimeError: the file in the cache is damaged.
    """
    options = kernel_options()
    arguments = [*options["cffi_extra_compile_args"], *OPTIMISATION]
    arguments += [f"-D{definition}" for definition in definitions]
    arguments += shlex.split(os.environ.get(FLAGS_VARIABLE, ""))
    # All on which the machine code depends; the version of Python, because cffi links against it.
    texts = [path.read_text(encoding="utf-8") for path in sorted(header.parent.glob("*.[ch]"))]
    digest = hashlib.sha1("\n".join([*texts, *arguments, sys.version]).encode()).hexdigest()
    module = f"gossamer_{name}_{digest[:HASH_DIGITS]}"
    path = Path(options["cache_dir"]) / f"{module}.so"

    def build() -> None:
        private_cache()
        if not path.exists():
            _build(module, path, header, sources, arguments)

    on_rank_zero(comm, build)
    specification = importlib.util.spec_from_file_location(module, path)
    if specification is None or specification.loader is None:
        raise RuntimeError(f"'{path}' is not a compiled module; remove it.")
    loaded = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(loaded)
    return CLibrary(loaded.lib, loaded.ffi)


def _build(
    module: str,
    path: Path,
    header: Path,
    sources: Sequence[str],
    arguments: Sequence[str],
) -> None:
    """Compile a module in a separate folder, and rename it when it is complete.

    Two runs may compile the same library at the same time; renaming is atomic, so that neither sees
    half a file.

    Raises:
        InputError: no C compiler was found.
        cffi.VerificationError: the compiler refuses the files.
        OSError: the folder cannot be written to.
    """
    require_compiler()
    import cffi

    path.parent.mkdir(parents=True, exist_ok=True)
    ffi = cffi.FFI()
    ffi.cdef(declarations_of(header))
    ffi.set_source(
        module,
        f'#include "{header.name}"',
        sources=[str(header.parent / source) for source in sources],
        include_dirs=[str(header.parent)],
        extra_compile_args=list(arguments),
        extra_link_args=[option for option in arguments if option.startswith("-fsanitize")],
    )
    with tempfile.TemporaryDirectory(dir=path.parent) as work:
        compiled = Path(ffi.compile(tmpdir=work))
        part = path.parent / f".{module}.{Path(work).name}"
        shutil.copy(compiled, part)
        part.rename(path)

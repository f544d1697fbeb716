"""Compilation of UFL forms and expressions, with the options of the just-in-time compiler.

FFCx stores kernels on disk under a signature, which takes longer to compute than many a scene to
run: 15 ms for each expression of a law.  So kernels that a process has loaded are found again by a
cheaper key, with the same content, from one pass through the expression.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
import shlex
import shutil
import stat
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from cffi import VerificationError
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from ufl.algorithms.analysis import extract_constants
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.algorithms.signature import compute_multiindex_hashdata
from ufl.core.multiindex import MultiIndex
from ufl.corealg.multifunction import MultiFunction
from ufl.utils.sorting import canonicalize_metadata, sorted_by_count
from ufl.variable import Label

from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.core.forms.backend import loaded_kernel

# Kernels that this process has loaded, by `_KernelKey.digest`.  They contain no mesh and no
# function.
_kernels: dict[bytes, Any] = {}


def require_compiler() -> None:
    """Raise `InputError` if there is no C compiler: the one that the variable CC names, or else the
    one that Python was built with, or else `cc`."""
    command = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    program = shlex.split(command)[0]
    check(
        shutil.which(program) is not None,
        f"The C compiler '{program}' is not there; install one (apt-get install gcc, "
        "or conda install c-compiler), or set the variable CC to the name of yours.",
    )


@cache
def kernel_options() -> dict[str, Any]:
    """Return the options of dolfinx's just-in-time compiler: cache folder, compiler flags, time
    limit.

    The cache folder is named after the processor: kernels are compiled for its instructions and may
    not run on another one.  It is below XDG_CACHE_HOME, or else ~/.cache.
    """
    cpu = hashlib.sha1(_processor_features().encode()).hexdigest()[:10]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return {
        "cache_dir": str(home / "gossamer_fx" / f"kernels-{cpu}"),
        # -mtune=generic: gcc's scheduling model of recent processors takes minutes for the
        # straight-line code of a tangent (26 s against 0.2 s measured on a Zen 5), and the kernels
        # run no faster for it.
        "cffi_extra_compile_args": ["-O2", "-g0", "-march=native", "-mtune=generic"],
        # Seconds to wait for a kernel that another process has begun; then see `_with_cache`.
        "timeout": 2,
    }


def _processor_features() -> str:
    """The line of /proc/cpuinfo with the instruction sets: "flags" on x86, "Features" on ARM."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith(("flags", "Features")):
            return line
    return platform.processor()


def constant(mesh: Mesh, value: float) -> fem.Constant:
    """Create a number for use in forms whose value may change without a new compilation.

    A literal in a form is part of the compiled code: each value would be compiled again.
    """
    return fem.Constant(mesh, default_scalar_type(value))


def compile_form(form: ufl.Form) -> fem.Form:
    """Compile a form, or load its kernel from the cache.  Collective.

    Args:
        form: UFL form on one mesh; literal numbers in it become part of the kernel, `constant`s do
            not.

    Raises:
        InputError: no C compiler was found.
        cffi.VerificationError: the compiler fails; on other ranks than 0 a RuntimeError.
    """
    key = _KernelKey()
    for integral in form.integrals():
        key.add_integral(integral)

    def make(form: ufl.Form) -> fem.Form:
        compiled: Any = fem.form(form, jit_options=kernel_options())
        # In the order of the kernel; dolfinx has them in C++ only.
        compiled.constants = form.constants()
        return compiled

    return _with_kernel(key, form, make)


def compile_expression(expression: Any, points: npt.NDArray[np.floating[Any]]) -> fem.Expression:
    """Compile an expression for evaluation at points of the cells.  Collective.

    Args:
        expression: UFL expression of functions on one mesh.
        points: points (n, tdim) of the reference cell.

    Raises:
        InputError: no C compiler was found.
        cffi.VerificationError: the compiler fails; on other ranks than 0 a RuntimeError.
    """
    key = _KernelKey.of_expression(expression, points)

    def make(expression: Any) -> fem.Expression:
        return fem.Expression(expression, points, comm=key.comm, jit_options=kernel_options())

    return _with_kernel(key, expression, make)


@dataclass(frozen=True, eq=False)
class ExpressionKernel:
    """The C function of an expression, and what it reads.

    Attributes:
        compiled: what FFCx made of the expression.
        coefficients: its functions, and
        constants: in the order in which the C function takes them.
    """

    compiled: Any
    coefficients: Sequence[fem.Function]
    constants: Sequence[fem.Constant]


def expression_kernel(expression: Any, points: npt.NDArray[np.floating[Any]]) -> ExpressionKernel:
    """Compile an expression to a C function of its values at points of one cell.  Collective.

    dolfinx's `Expression`, which `compile_expression` returns, goes four times through the whole
    expression to find functions and constants.  Of a film that wrinkles this took a third of the
    time in which a scene is compiled.  The key of the kernel has found them.  Arguments and errors
    are those of `compile_expression`.
    """
    key = _KernelKey.of_expression(expression, points)
    digest = key.digest()
    if not key.comm.allreduce(digest in _kernels, op=MPI.LAND):
        compile_expression(expression, points)
    compiled, *_ = _kernels[digest]
    return ExpressionKernel(compiled, key.counted(ufl.Coefficient), key.counted(ufl.Constant))


class _KernelKey:
    """What the kernel of a form or expression depends on, as data without meshes and functions.

    It is what FFCx signs: operators, terminals with their elements, and integrals with their
    metadata.  Functions, constants, labels, meshes and indices have numbers by their first
    occurrence.  FFCx sorts the arguments of a kernel by the order in which the program created
    functions and constants, so that this order belongs to the key.
    """

    def __init__(self) -> None:
        self._numbers = _FirstOccurrences()
        self._indices: dict[Any, int] = {}
        # Different subexpressions, with their numbers, and the number of each object that was seen.
        self._different: dict[Any, int] = {}
        self._seen: dict[int, int] = {}
        self._whole: list[Any] = []

    @classmethod
    def of_expression(cls, expression: Any, points: npt.NDArray[np.floating[Any]]) -> _KernelKey:
        """The key of an expression at points (n, tdim) of the reference cell."""
        key = cls()
        key.add(expression, points.shape, points.tobytes())
        return key

    def add(self, expression: Any, *details: Any) -> None:
        """Add an expression that is compiled, and what its kernel depends on in addition."""
        self._whole.append((self._number(expression), details))

    def add_integral(self, integral: ufl.Integral) -> None:
        """Add an integral of a form."""
        self.add(
            integral.integrand(),
            integral.integral_type(),
            integral.ufl_domain()._ufl_signature_data_(self._numbers),
            integral.subdomain_id(),
            canonicalize_metadata(integral.metadata()),
        )

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the mesh."""
        mesh = next(one for one in self._numbers if isinstance(one, ufl.Mesh))
        return mesh.ufl_cargo().comm

    def digest(self) -> bytes:
        """A hash of all that was added, and of the options of the compiler."""
        kinds = (ufl.Coefficient, ufl.Constant)
        orders = [[self._numbers[one] for one in self.counted(kind)] for kind in kinds]
        options = sorted(kernel_options().items())
        content = (list(self._different), self._whole, orders, options)
        return hashlib.sha256(repr(content).encode()).digest()

    def counted(self, kind: type) -> list[Any]:
        """The functions or the constants, in the order in which they were created, in which FFCx
        takes them."""
        return list(sorted_by_count([one for one in self._numbers if isinstance(one, kind)]))

    def _number(self, expression: Any) -> int:
        """The number of an expression: equal ones have the same."""
        seen = self._seen
        # A stack in place of recursion: sums of UFL are deeper than Python's stack.
        waiting = [expression]
        while waiting:
            one = waiting[-1]
            operands = one.ufl_operands
            new = [operand for operand in operands if id(operand) not in seen]
            if new:
                waiting += new
                continue
            waiting.pop()
            if id(one) in seen:
                continue
            if one._ufl_is_terminal_:
                content = (one._ufl_typecode_, self._terminal(one))
            else:
                content = (one._ufl_typecode_, *[seen[id(operand)] for operand in operands])
            seen[id(one)] = self._different.setdefault(content, len(self._different))
        return seen[id(expression)]

    def _terminal(self, terminal: Any) -> Any:
        """What FFCx signs of a function, a constant, a number, an index or a geometric quantity."""
        if isinstance(terminal, MultiIndex):
            return compute_multiindex_hashdata(terminal, self._indices)
        if isinstance(terminal, Label):
            return self._numbers[terminal]
        return terminal._ufl_signature_data_(self._numbers)


class _FirstOccurrences(dict[Any, int]):
    """Numbers of objects, which they get when they are first asked for."""

    def __missing__(self, key: Any) -> int:
        self[key] = len(self)
        return self[key]


def _with_kernel[T](key: _KernelKey, of: Any, make: Callable[[Any], T]) -> T:
    """Compile a UFL form or expression by `make`, which gets it with renumbered constants, or as it
    is if this process has loaded the kernel of this key already.  Collective."""
    comm = key.comm
    digest = key.digest()
    # A rank may have compiled a form that others have not, on a separate mesh.
    if comm.allreduce(digest in _kernels, op=MPI.LAND):
        with loaded_kernel(_kernels, digest):
            return make(of)
    _kernels.pop(digest, None)
    numbered = map_integrand_dags(_Number(of), of)
    with loaded_kernel(_kernels, digest):
        return _with_cache(comm, lambda: make(numbered))


class _Number(MultiFunction):
    """Renumbers the constants of a form or expression, and the labels of `ufl.variable`, from zero.

    UFL numbers them in the order in which the program creates them.  It puts the numbers of labels
    into the signature of a form, and sorts factors and summands by the numbers of constants as
    text, 10 before 9.  Without this class the signature, by which kernels are cached, would depend
    on everything that was created before, and the same law would be compiled again.
    """

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, of: Any) -> None:
        """Number the constants of a form or expression in the order in which UFL finds them."""
        super().__init__()
        self._labels: dict[Label, Label] = {}
        self._constants: dict[Any, ufl.Constant] = {}
        for number, old in enumerate(extract_constants(of)):
            self._constants[old] = _numbered(old, number)

    def label(self, label: Label) -> Label:
        """The new label of a variable."""
        return self._labels.setdefault(label, Label(len(self._labels)))

    def constant(self, constant: fem.Constant) -> ufl.Constant:
        """The new constant that stands for an old one."""
        return self._constants[constant]


def _numbered(constant: fem.Constant, number: int) -> ufl.Constant:
    """A constant with another number that shares the value of a given one."""
    same = ufl.Constant(constant.ufl_domain(), constant.ufl_shape, count=number)
    # Both refer to one C++ object: when the program changes the value, compiled forms see it.
    same._cpp_object = constant._cpp_object
    return same


def _with_cache[T](comm: MPI.Intracomm, task: Callable[[], T]) -> T:
    """Run a compilation; if it fails, remove unfinished kernels from the cache and run it again.
    Collective.

    dolfinx takes a source file without a kernel for one that another process is compiling, and
    gives up after the time limit.  A run that was killed while it compiled would thus make all
    later runs fail.  Processes that compile hold a shared lock, which the system releases when they
    end; whoever gets the exclusive lock knows that nothing is being compiled.
    """
    on_rank_zero(comm, private_cache)
    try:
        with _shared_lock(comm):
            return task()
    except (TimeoutError, RuntimeError, VerificationError):
        # Without a compiler every attempt fails, and dolfinx does not say why.
        on_rank_zero(comm, require_compiler)
        if comm.rank == 0:
            _remove_unfinished()
    # The second failure is a real one, and goes to the caller.
    with _shared_lock(comm):
        return task()


def private_cache() -> Path:
    """The cache folder, which is made, and in which nobody else can put code.

    Kernels are machine code that is executed.  Looked at once for each process, on one rank.

    Raises:
        InputError: the folder cannot be made, or it or a file in it belongs to another user, or
            others may write it.
    """
    folder = Path(kernel_options()["cache_dir"])
    _require_private(folder)
    return folder


@cache
def _require_private(folder: Path) -> None:
    """Make a folder, and refuse one in which others can put code."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"The folder '{folder}' for compiled laws cannot be made ({error.strerror}); set "
            "XDG_CACHE_HOME to a folder that can be written."
        ) from error
    writable_by_others = stat.S_IWGRP | stat.S_IWOTH
    # Files in a folder that others cannot enter are safe whatever their mode.
    is_open = bool(folder.stat().st_mode & (stat.S_IXGRP | stat.S_IXOTH))
    for path in (folder, *folder.iterdir()):
        try:
            about = path.lstat()
        except FileNotFoundError:
            continue  # a temporary file of another process, which has just removed it
        is_others = about.st_uid not in (os.getuid(), 0)
        may_be_written = is_open and bool(about.st_mode & writable_by_others)
        check(
            not (is_others or may_be_written or path.is_symlink()),
            f"'{path}' belongs to another user or may be written by others, and its code would be "
            f"executed; remove {folder}, or set XDG_CACHE_HOME to a folder of yours.",
        )


def _shared_lock(comm: MPI.Intracomm) -> AbstractContextManager[Any]:
    """Shared lock of the cache for rank 0, which compiles; the other ranks wait for it."""
    if comm.rank == 0:
        return _lock(fcntl.LOCK_SH)
    return nullcontext()


@contextmanager
def _lock(kind: int) -> Iterator[Path | None]:
    """Lock the cache folder: `fcntl.LOCK_SH` shared, `fcntl.LOCK_EX` exclusive; None on a file
    system that has no locks, as some network file systems."""
    folder = private_cache()
    is_locked = True
    with (folder / "lock").open("w") as file:
        try:
            fcntl.flock(file, kind)
        except OSError:
            is_locked = False
        yield folder if is_locked else None


def _remove_unfinished() -> None:
    """Remove C sources from the cache whose compilation was not finished."""
    with _lock(fcntl.LOCK_EX) as folder:
        # Without a lock another process may be compiling them.
        if folder is None:
            return
        for source in folder.glob("libffcx_*.c"):
            if not source.with_suffix(".c.cached").exists():
                source.unlink()

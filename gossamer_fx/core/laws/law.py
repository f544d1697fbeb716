"""Laws: plain Python functions of named numbers, compiled to one C function with exact derivatives.

A law is written once, with the numbers it depends on as arguments, and with `if` where it has
branches.  `tracing` runs it with UFL expressions, UFL takes the derivatives of each branch, and
`c_text` prints one C function of them, which is compiled and cached like the kernels of forms.

Why UFL and not FFCx for the C code.  A two-way choked orifice with its eight derivatives, as one
expression with `ufl.conditional` compiled by FFCx and as written here, in CPU time of one run:

| | FFCx | this module |
|---|---|---|
| first compilation [s] | 0.5 | 0.6 |
| from the cache on disk [ms] | 380 | 3 |
| a call without that of cffi [µs] | 0.5 | 0.1 |

FFCx computes all branches in each call, and the slope of a condition is the sum over both sides
times 0 or 1: nan where the side that does not hold has an infinite one.  A law that solves an
equation is not an expression of UFL.  sympy takes 0.6 s for the same derivatives and 0.4 s
to import, UFL 0.03 s; the rest of the first compilation is that of the C compiler.

A function that cannot be traced, because it needs numbers, still is a law: it is called back from C
with derivatives by complex steps if it takes complex numbers, otherwise by differences.
`Law.derivatives` says which.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import shlex
import subprocess
import sysconfig
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

import cffi
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.errors import on_rank_zero
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.forms.c_source import HASH_DIGITS
from gossamer_fx.core.forms.compilation import kernel_options, private_cache, require_compiler
from gossamer_fx.core.laws.c_text import c_text
from gossamer_fx.core.laws.tracing import NotTraceable, inputs_of, trace, with_slopes

Array = npt.NDArray[np.float64]

# How derivatives are taken, exact to round-off the first two, the last to some eight digits
Derivatives = Literal["compiled", "complex steps", "differences"]

# Complex steps have no cancellation; its square is negligible.
COMPLEX_STEP = 1e-30

# A function may take complex numbers and lose their imaginary part, e.g. by `float`: both ways to a
# derivative are compared at the first call, and may differ by this share of the largest.
COMPLEX_AGREEMENT = 1e-3

# Share of a number, or its size where that is zero, by which it is varied for a difference: the
# cube root of round-off.
DIFFERENCE_STEP = 6e-6

# As of `forms.c_source`, without vectorisation, which a law has no loops for
OPTIONS = ("-fno-math-errno", "-ffp-contract=off")

SIGNATURES = """
void law(const double *x, double *f, double *df, double *ddf);
void rows(long n, const double *x, double *f, double *df);
"""


@cache
def _ffi() -> Any:
    """The declarations of laws, as cffi reads them."""
    ffi = cffi.FFI()
    ffi.cdef(SIGNATURES)
    ffi.cdef("typedef void (*law_function)(const double *, double *, double *, double *);")
    return ffi


class Law:
    """A law as a C function, `void (*)(const double *x, double *f, double *df, double *ddf)`.

    x are its inputs, f its outputs, df (outputs, by) and ddf (outputs, by, by) their derivatives;
    df and ddf may be null.

    Attributes:
        names: of the inputs, in the order of x.
        by: of those by which derivatives are taken.
        output_count: number of outputs.
        orders: 1 or 2 orders of derivatives.
        derivatives: "compiled" if they are exact C code, otherwise "complex steps" or
            "differences" of the Python function.
        address: of the C function.
    """

    derivatives: Derivatives

    def __init__(
        self, names: Sequence[str], by: Sequence[str], output_count: int, orders: int
    ) -> None:
        self.names = tuple(names)
        self.by = tuple(by)
        self.output_count = output_count
        self.orders = orders
        self.address = 0

    @property
    def _function(self) -> Any:
        return _ffi().cast("law_function", self.address)

    def __call__(self, *inputs: float) -> tuple[Array, ...]:
        """Return outputs (outputs,) and derivatives (outputs, by), with those of the second order
        (outputs, by, by) if the law has them.

        Example:
            >>> from mpi4py import MPI
            >>> from gossamer_fx.core.laws.law import compile_law
            >>> def kinetic(m, v):
            ...     return m * v * v / 2
            >>> value, slopes = compile_law(kinetic, by=("v",), comm=MPI.COMM_SELF)(2.0, 3.0)
            >>> float(value[0]), float(slopes[0, 0])
            (9.0, 6.0)
        """
        x = np.array(inputs, dtype=float)
        shape = [self.output_count]
        arrays = []
        for _ in range(self.orders + 1):
            arrays.append(np.zeros(shape))
            shape.append(len(self.by))
        ffi = _ffi()
        pointers = [ffi.from_buffer("double[]", array) for array in (x, *arrays)]
        pointers += [ffi.NULL] * (4 - len(pointers))
        self._function(*pointers)
        self.raise_error()
        return tuple(arrays)

    def of_rows(self, x: Array, *, slopes: bool = True) -> tuple[Array, Array]:
        """Return outputs (n, outputs) and first derivatives (n, outputs, by) of n rows of inputs x
        (n, inputs); without `slopes` the derivatives are empty.

        Example:
            >>> from mpi4py import MPI
            >>> from gossamer_fx.core.laws.law import compile_law
            >>> law = compile_law(lambda x, k: k * x, by=("x",), comm=MPI.COMM_SELF)
            >>> law.of_rows(np.array([[1.0, 2.0], [3.0, 4.0]]))[0].tolist()
            [[2.0], [12.0]]
        """
        n = len(x)
        outputs = np.zeros((n, self.output_count))
        shape = (n, self.output_count, len(self.by))
        derivatives = np.zeros(shape if slopes else (0,))
        self._compute_rows(np.ascontiguousarray(x), outputs, derivatives)
        self.raise_error()
        return outputs, derivatives

    def _compute_rows(self, x: Array, outputs: Array, derivatives: Array) -> None:
        """Write outputs, and derivatives unless that array is empty."""
        for number in range(len(x)):
            outputs[number], slopes = self(*x[number].tolist())[:2]
            if derivatives.size:
                derivatives[number] = slopes

    def raise_error(self) -> None:
        """Raise what the law raised since the last call of this method; C cannot."""


class CompiledLaw(Law):
    """A law in C."""

    derivatives: Derivatives = "compiled"

    def __init__(
        self,
        names: Sequence[str],
        by: Sequence[str],
        output_count: int,
        orders: int,
        library: Any,
    ) -> None:
        super().__init__(names, by, output_count, orders)
        # It keeps the code of the function.
        self._library = library
        self.address = int(_ffi().cast("intptr_t", library.law))

    def _compute_rows(self, x: Array, outputs: Array, derivatives: Array) -> None:
        ffi = _ffi()
        buffers = [ffi.from_buffer("double[]", array) for array in (x, outputs, derivatives)]
        if not derivatives.size:
            buffers[2] = ffi.NULL
        self._library.rows(len(x), *buffers)


class PythonLaw(Law):
    """A law whose Python function is called from C.

    Its derivatives are by complex steps until a number turns out to be lost by them.
    """

    def __init__(
        self,
        names: Sequence[str],
        by: Sequence[str],
        output_count: int,
        orders: int,
        law: Callable[..., Any],
        slopes_by: Sequence[str],
    ) -> None:
        super().__init__(names, by, output_count + len(slopes_by), orders)
        self._law = law
        self._slopes_by = [self.names.index(name) for name in slopes_by]
        self._columns = [self.names.index(name) for name in self.by]
        self._error: BaseException | None = None
        self._is_compared = False
        self.derivatives = "complex steps"
        ffi = _ffi()
        # It has to live as long as C may call it.
        self._callback = ffi.callback("law_function", self._call, onerror=self._keep_error)
        self.address = int(ffi.cast("intptr_t", self._callback))

    def raise_error(self) -> None:
        error = self._error
        self._error = None
        if error is not None:
            raise error

    def _keep_error(self, kind: Any, error: BaseException, traceback: Any) -> None:
        """Keep the first error for `raise_error`."""
        if self._error is None:
            self._error = error

    def _call(self, x: Any, f: Any, df: Any, ddf: Any) -> None:
        """What C calls."""
        ffi = _ffi()
        count = self.output_count
        width = len(self.by)
        given = np.array(ffi.unpack(x, len(self.names)))
        outputs = ffi.buffer(f, 8 * count)
        # What C reads if the law raises an error
        np.frombuffer(outputs)[:] = np.nan
        np.frombuffer(outputs)[:] = self._values(given).real
        if df != ffi.NULL:
            np.frombuffer(ffi.buffer(df, 8 * count * width))[:] = self._slopes(given).ravel()
        if ddf != ffi.NULL:
            second = self._differences(self._slopes, given)
            np.frombuffer(ffi.buffer(ddf, 8 * count * width**2))[:] = second.ravel()

    def _values(self, x: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Outputs (outputs,) for real or complex inputs."""
        outputs = self._law(*x.tolist())
        several = list(outputs) if isinstance(outputs, tuple | list) else [outputs]
        for position in self._slopes_by:
            step = DIFFERENCE_STEP * (abs(x[position]) or 1.0)
            ends = []
            for sign in (-1, 1):
                varied = x.copy()
                varied[position] += sign * step
                result = self._law(*varied.tolist())
                ends.append(result[0] if isinstance(result, tuple | list) else result)
            several.append((ends[1] - ends[0]) / (2 * step))
        return np.array(several)

    def _slopes(self, x: Array) -> Array:
        """Derivatives (outputs, by)."""
        if self.derivatives == "differences":
            return self._differences(self._values, x)
        try:
            slopes = self._by_complex_steps(x)
        # A law that needs real numbers may fail in any way.
        except Exception:
            self.derivatives = "differences"
            return self._differences(self._values, x)
        if not self._is_compared:
            self._is_compared = True
            differences = self._differences(self._values, x)
            largest = abs(differences).max(axis=1, keepdims=True)
            if (abs(slopes - differences) > COMPLEX_AGREEMENT * largest).any():
                self.derivatives = "differences"
                return differences
        return slopes

    def _by_complex_steps(self, x: Array) -> Array:
        slopes = np.zeros((self.output_count, len(self.by)))
        for number, column in enumerate(self._columns):
            varied = x.astype(complex)
            varied[column] += 1j * COMPLEX_STEP
            slopes[:, number] = self._values(varied).imag / COMPLEX_STEP
        return slopes

    def _differences(self, function: Callable[[Array], Array], x: Array) -> Array:
        """Derivatives (..., by) of a function with values (...), by differences over both sides."""
        columns = []
        for column in self._columns:
            step = DIFFERENCE_STEP * (abs(x[column]) or 1.0)
            above = x.copy()
            below = x.copy()
            above[column] += step
            below[column] -= step
            columns.append((function(above) - function(below)) / (above[column] - below[column]))
        return np.stack(columns, axis=-1)


# Libraries of this process by the hash of their text
_loaded: dict[str, Any] = {}


def compile_law(
    law: Callable[..., Any],
    *,
    by: Sequence[str],
    orders: int = 1,
    comm: MPI.Intracomm,
    names: Sequence[str] = (),
    output_count: int = 1,
    slopes_by: Sequence[str] = (),
) -> Law:
    """Compile a law to a C function, or find it in the cache.  Collective.

    Args:
        law: a function of real numbers that returns a number or several, in SI units.
            It must be a function of its arguments alone: other numbers that it reads become
            constants of the code.  It may compare, use `min`, `max`, `abs` and NumPy's functions of
            one number, and solve equations by `tracing.root`.
        by: names of the arguments by which derivatives are taken.
        orders: 1 for first derivatives, 2 for second ones in addition.
        comm: whose ranks call this function together.
        names: of the arguments; empty for those of the function.
        output_count: how many numbers the law returns.
        slopes_by: names of arguments; the derivatives of the first output by them become further
            outputs of the law.

    Raises:
        InputError: `by` has a name that is not an argument, or there is no C compiler.

    Example:
        >>> from mpi4py import MPI
        >>> from gossamer_fx.core.laws.law import compile_law
        >>> def spring(x, k):
        ...     return k * x if x > 0 else 0.0
        >>> compile_law(spring, by=("x", "k"), comm=MPI.COMM_SELF).derivatives
        'compiled'
    """
    found = tuple(names) or tuple(inspect.signature(law).parameters)
    for name in by:
        check_known("A law", "argument", name, found)
    inputs = inputs_of(len(found))
    columns = [found.index(name) for name in by]
    slopes = [found.index(name) for name in slopes_by]
    try:
        tree = trace(law, inputs)
        values = c_text(tree, inputs, columns, 0)
    except NotTraceable:
        return PythonLaw(found, by, output_count, orders, law, slopes_by)
    arguments = [*kernel_options()["cffi_extra_compile_args"], *OPTIONS]
    # The values determine the derivatives; this file and those that it uses how they are written.
    key = "\n".join([values, repr((columns, orders, slopes)), *arguments, _own_text()])
    digest = hashlib.sha1(key.encode()).hexdigest()[:HASH_DIGITS]
    path = Path(kernel_options()["cache_dir"]) / f"law_{digest}.so"

    def build() -> None:
        private_cache()
        if not path.exists():
            whole = with_slopes(tree, [inputs[number] for number in slopes])
            build_library(c_text(whole, inputs, columns, orders), path, arguments)

    on_rank_zero(comm, build)
    if digest not in _loaded:
        _loaded[digest] = _ffi().dlopen(str(path))
    count = output_count + len(slopes_by)
    return CompiledLaw(found, by, count, orders, _loaded[digest])


@cache
def _own_text() -> str:
    """The text of this room, on which the code of a law depends."""
    paths = sorted(Path(__file__).parent.glob("*.py"))
    return "\n".join(path.read_text(encoding="utf-8") for path in paths)


def build_library(text: str, path: Path, arguments: Sequence[str]) -> None:
    """Compile C code to a library.  It is made in a separate folder and renamed when it is
    complete: two runs may compile the same law at the same time."""
    require_compiler()
    compiler = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as work:
        source = Path(work) / "law.c"
        source.write_text(text)
        compiled = Path(work) / path.name
        command = [*shlex.split(compiler), "-shared", "-fPIC", *arguments]
        finished = subprocess.run(
            [*command, str(source), "-o", str(compiled), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        if finished.returncode:
            raise RuntimeError(f"The C compiler refused generated code: {finished.stderr}")
        compiled.rename(path)

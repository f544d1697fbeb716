"""Compilation of UFL: the one place that knows the options of the just-in-time compiler."""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from ufl.algorithms.analysis import extract_constants
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.corealg.multifunction import MultiFunction
from ufl.variable import Label


@cache
def kernel_options() -> dict[str, Any]:
    """Options of the C compiler, and a kernel cache of this processor alone: its kernels may not run on another.

    `-mtune=generic`: gcc's scheduling model of recent processors takes minutes for the straight-line code of a
    tangent (26 s against 0.2 s measured on a Zen 5), and the kernels run no faster for it.
    """
    flags = next(
        (
            line
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith(("flags", "Features"))
        ),
        platform.processor(),
    )
    cpu = hashlib.sha1(flags.encode()).hexdigest()[:10]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return {
        "cache_dir": str(home / "gossamer_fx" / f"kernels-{cpu}"),
        "cffi_extra_compile_args": ["-O2", "-g0", "-march=native", "-mtune=generic"],
        "timeout": 2,  # s to wait for a kernel that another process has begun; then see `_with_cache`
    }


def constant(mesh: Mesh, value: float) -> fem.Constant:
    """A number that may change without a new compilation, as a literal in a form may not."""
    return fem.Constant(mesh, default_scalar_type(value))


def compile_form(form: ufl.Form) -> fem.Form:
    """Compile a form (or take its kernel from the cache)."""
    comm, numbered = form.ufl_domain().ufl_cargo().comm, map_integrand_dags(_Number(form), form)
    return _with_cache(comm, lambda: fem.form(numbered, jit_options=kernel_options()))


def compile_expression(expression: Any, points: npt.NDArray[np.floating[Any]]) -> fem.Expression:
    """Compile an expression for evaluation at `points` of the reference cell, shape (n, tdim)."""
    comm = ufl.domain.extract_unique_domain(expression).ufl_cargo().comm
    numbered = map_integrand_dags(_Number(expression), expression)
    return _with_cache(comm, lambda: fem.Expression(numbered, points, jit_options=kernel_options()))


class _Number(MultiFunction):
    """Numbers the constants of a form or expression, and the labels of `ufl.variable`, from zero.

    The program numbers them in the order in which they are made.  UFL puts the labels' numbers into the signature, and
    sorts factors and summands by the constants' numbers as words, 10 before 9: without this, what a kernel is called
    would depend on what else was made before, and the same law would be compiled anew.
    """

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, of: Any) -> None:
        super().__init__()
        self._labels: dict[Label, Label] = {}
        self._constants = {old: _numbered(old, k) for k, old in enumerate(extract_constants(of))}

    def label(self, label: Label) -> Label:
        return self._labels.setdefault(label, Label(len(self._labels)))

    def constant(self, constant: fem.Constant) -> ufl.Constant:
        return self._constants[constant]


def _numbered(constant: fem.Constant, number: int) -> ufl.Constant:
    """The same constant, whose value is also changed when the other's is, by another number."""
    same = ufl.Constant(constant.ufl_domain(), constant.ufl_shape, count=number)
    same._cpp_object = constant._cpp_object
    return same


def _with_cache[T](comm: MPI.Intracomm, task: Callable[[], T]) -> T:
    """Compile; if it fails, once more without the kernels that were begun and will never be finished.

    The compiler takes a source file without a kernel for one that another process is compiling, and gives up after a
    while; so a run that was interrupted while it compiled would spoil all later ones.  Processes that compile hold a
    shared lock, which ends with them: who has it alone knows that nothing is being compiled.
    """
    leads = comm.rank == 0  # it compiles for all, while they wait
    try:
        with _lock(fcntl.LOCK_SH) if leads else nullcontext():
            return task()
    except (TimeoutError, RuntimeError):
        if leads:
            _remove_unfinished()
    with _lock(fcntl.LOCK_SH) if leads else nullcontext():
        return task()


@contextmanager
def _lock(kind: int) -> Iterator[Path]:
    """Hold the cache folder, shared or alone."""
    folder = Path(kernel_options()["cache_dir"])
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        fcntl.flock(file, kind)
        yield folder


def _remove_unfinished() -> None:
    with _lock(fcntl.LOCK_EX) as folder:
        for source in folder.glob("libffcx_*.c"):
            if not source.with_suffix(".c.cached").exists():
                source.unlink()

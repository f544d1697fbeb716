"""Compilation of UFL: the one place that knows the options of the just-in-time compiler."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh


@cache
def _options() -> dict[str, Any]:
    """Options of the C compiler, and a kernel cache of this processor alone: its kernels may not run on another.

    `-mtune=generic`: gcc's scheduling model of recent processors takes minutes for the straight-line code of a
    tangent (26 s against 0.2 s measured on a Zen 5), and the kernels run no faster for it.
    """
    flags = next(
        (line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith(("flags", "Features"))),
        platform.processor(),
    )
    cpu = hashlib.sha1(flags.encode()).hexdigest()[:10]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return {
        "cache_dir": str(home / "gossamer_fx" / f"kernels-{cpu}"),
        "cffi_extra_compile_args": ["-O2", "-g0", "-march=native", "-mtune=generic"],
    }


def constant(mesh: Mesh, value: float) -> fem.Constant:
    """A number that may change without a new compilation, as a literal in a form may not."""
    return fem.Constant(mesh, default_scalar_type(value))


def compile_form(form: ufl.Form) -> fem.Form:
    """Compile a form (or take its kernel from the cache)."""
    return fem.form(form, jit_options=_options())


def compile_expression(expression: Any, points: npt.NDArray[np.float64]) -> fem.Expression:
    """Compile an expression for evaluation at `points` of the reference cell, shape (n, tdim)."""
    return fem.Expression(expression, points, jit_options=_options())

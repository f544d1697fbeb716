"""Convergence of a quantity with the mesh: errors, orders and run times, as a table and a picture.

With the values v of meshes of size h, the error of each is |v - v*|, v* the exact value.  If that
is not known, it is estimated from the three finest meshes, whose values change by Δ1 and then by Δ2
(Richardson extrapolation):

    v* = v3 + Δ2/((h2/h3)^p - 1),    Δ1/Δ2 = ((h1/h2)^p - 1)/(1 - (h3/h2)^p)                  (1)

where the second equation gives the order p; for sizes of one ratio r it is p = log(Δ1/Δ2)/log r.

The estimate is valid in the asymptotic range only, where one power of h dominates the error.
Outside of it `extrapolated` raises the reason, and a quantity has no limit and no errors.
"""

from __future__ import annotations

import logging
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import (
    ErrorCurve,
    draw_error_curves,
    markdown_table,
    number_text,
    observed_order,
)
from gossamer_fx.core.checks.arguments import at_least, check_arguments, positive
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import corner_points, sizes
from gossamer_fx.core.model.body import Array

LOG = logging.getLogger("gossamer_fx")

# The name of a quantity that is returned as a number.
ONLY = "value"

# The unit at the end of a quantity's name
_UNIT = re.compile(r"\[([^]]*)\]$")

# What helps outside the asymptotic range.
FINER = "give finer meshes, or as `exact` the value of a much finer one"

# Orders between which (1) is solved.  Below the smallest, v* is farther from the finest value than
# that is from the coarsest of the three, so that the estimate says more about p than about v*.
# Orders above the largest are not seen in finite elements.
MIN_ORDER = 0.5
MAX_ORDER = 10.0

# Largest change of the order from the three meshes before to the last three.  In the asymptotic
# range it is a few tenths.
MAX_ORDER_CHANGE = 1.0

# Differences over the largest value, below which values count as equal: an equilibrium is not
# known to more digits.
EQUAL_VALUES = 1e-8

# A limit whose sign differs from that of all values, over the finest value.  A smaller one is the
# estimate of a zero.
MAX_OVERSHOOT = 0.1


@check_arguments
@dataclass(frozen=True, eq=False)
class Convergence:
    """Values of quantities on meshes of different size, from the coarsest to the finest.

    Attributes:
        sizes: h of the meshes (n,) [m]: the root of twice the mean area of triangles, or the mean
            length of line elements; or the numbers that were given.
        cells: numbers of cells (n,); zeros where they are not known.
        seconds: CPU time of each computation (n,) [s], of rank 0.
        values: of each quantity (n,), by name; NaN on meshes that gave no finite number, which are
            left out.
        exact: value that errors refer to, by name; a quantity without one is left out.
        is_extrapolated: whether it was estimated by (1), by name.
        remarks: reason for which no exact value was extrapolated, by name: the values oscillate,
            are all equal, or have no steady order.

    Example:
        >>> found = gx.analysis.convergence(lambda n: 2.0 + 1.0 / n**2, meshes=[4, 8, 16])
        >>> found.orders["value"].round(2)
        array([nan,  2.,  2.])
    """

    sizes: Array
    cells: Array
    seconds: Array
    values: Mapping[str, Array]
    exact: Mapping[str, float]
    is_extrapolated: Mapping[str, bool]
    remarks: Mapping[str, str] = field(default_factory=dict)

    @property
    def errors(self) -> dict[str, Array]:
        """|v - v*|, over |v*| unless that is zero, (n,) by name."""
        found: dict[str, Array] = {}
        for name, values in self.values.items():
            exact = self.exact.get(name, math.nan)
            found[name] = np.abs(values - exact) / (abs(exact) or 1.0)
        return found

    @property
    def orders(self) -> dict[str, Array]:
        """Observed order between each mesh and the one before that has an error, (n,) by name; NaN
        of the first, and of meshes without an error."""
        found: dict[str, Array] = {}
        for name, errors in self.errors.items():
            orders = np.full(len(errors), np.nan)
            for before, k in pairwise(np.flatnonzero(np.isfinite(errors))):
                orders[k] = observed_order(
                    errors[before], errors[k], self.sizes[before], self.sizes[k]
                )
            found[name] = orders
        return found

    def table(self) -> str:
        """A table in Markdown: size, number of cells, value, relative error, order and CPU time of
        each mesh."""
        return "\n".join([markdown_table(self._rows()).rstrip(), *self._notes()])

    def _rows(self) -> Iterator[list[str]]:
        """Cells of the table, row by row; first the headings."""
        has_cells = bool(self.cells.any())
        head = ["h"]
        if has_cells:
            head.append("cells")
        for name in self.values:
            head += [name, "error", "order"]
        head.append("CPU time [s]")
        yield head
        errors = self.errors
        orders = self.orders
        for k in range(len(self.sizes)):
            cells = [f"{self.sizes[k]:.3g}"]
            if has_cells:
                cells.append(f"{self.cells[k]:.0f}")
            for name, values in self.values.items():
                cells += [f"{values[k]:.6g}", number_text(errors[name][k], ".1e")]
                cells.append(number_text(orders[name][k], ".1f"))
            cells.append(f"{self.seconds[k]:.2g}")
            yield cells

    def _notes(self) -> Iterator[str]:
        """Lines below the table: meshes that are left out, and to what errors refer, or why there
        are none."""
        for name, values in self.values.items():
            words = _left_out(name, self.sizes, values)
            if words:
                yield f"\n{words}."
        for name, is_extrapolated in self.is_extrapolated.items():
            if is_extrapolated:
                yield (
                    f"\nErrors of {name} refer to {self.exact[name]:.6g}, extrapolated from the "
                    "three finest meshes."
                )
            elif name in self.remarks:
                yield f"\n{name} has no errors: {self.remarks[name]}.{self._last_change(name)}"

    def _last_change(self, name: str) -> str:
        """A sentence with the relative change between the two finest meshes; nothing if it is 0."""
        values = self.values[name]
        before, last = values[np.isfinite(values)][-2:]
        change = abs(last - before) / (abs(last) or 1.0)
        if change == 0:
            return ""
        return f"  The relative change between the two finest meshes is {change:.1e}."

    @check_arguments
    def plot(
        self, path: str | Path, *, others: Mapping[str, Convergence] | None = None, name: str = ""
    ) -> None:
        """Write a PNG of the errors against the CPU time and against h.

        Quantities without errors are left out; if none has any, their values are drawn, those of
        each unit ("height [m]") on separate axes.

        Args:
            path: of the file, ending in `.png`.
            others: further computations, e.g. with another element, by the names of their curves.
            name: of the curves of this one; default: the names of the quantities.

        Raises:
            OutputFailure: the file cannot be written.
        """
        curves = self._curves(name, others or {}, of_errors=True)
        if curves:
            draw_error_curves(path, {"relative error": curves})
            return
        # Errors need a limit.  Without any, the values themselves show why there is none.
        rows = {}
        for unit in dict.fromkeys(_unit_of(quantity) for quantity in self.values):
            label = f"value [{unit}]" if unit else "value"
            rows[label] = self._curves(name, others or {}, of_errors=False, unit=unit)
        draw_error_curves(
            path,
            rows,
            title="No errors: see the remarks below the table",
            are_errors=False,
        )

    def _curves(
        self,
        name: str,
        others: Mapping[str, Convergence],
        *,
        of_errors: bool,
        unit: str | None = None,
    ) -> list[ErrorCurve]:
        """Curves of `plot`, one for each quantity of each series.

        Args:
            name: label of this series; may be empty.
            others: further series by label.
            of_errors: whether errors are drawn, of quantities that have any, instead of values.
            unit: of the quantities; None: all of them.
        """
        curves = []
        for label, found in {name: self, **others}.items():
            quantities = found.values
            if of_errors:
                quantities = {k: e for k, e in found.errors.items() if np.isfinite(e).any()}
            for quantity, values in quantities.items():
                if unit is not None and unit != _unit_of(quantity):
                    continue
                words = ", ".join(word for word in (label, quantity) if word)
                if label and len(found.values) == 1:
                    words = label
                curves.append(ErrorCurve(words, found.seconds, values, found.sizes))
        return curves


@check_arguments(as_many("meshes", "sizes"))
def convergence(
    quantity: Callable[[Any], Any],
    *,
    meshes: Annotated[Sequence[Any], at_least(2)],
    sizes: Sequence[Annotated[float, positive()]] = (),
    exact: float | Mapping[str, float] | None = None,
) -> Convergence:
    """Compute quantities on several meshes, and their errors, orders and run times.

    The coarsest mesh is computed once more before, so that its time is without compilation.  If the
    values do not show a limit, `remarks` and a warning in the log say why.  A mesh on which a
    quantity is not finite is named in a warning, and left out for this quantity.

    Args:
        quantity: a function of one of the meshes that returns a number, or numbers by name; e.g. it
            builds a scene, finds its equilibrium and reads a displacement.  A name may end with a
            unit, "height [m]".
        meshes: two or more: each a `Mesh`, or anything else that the function takes, e.g. numbers
            of cells.
        sizes: h of each; default: of a `Mesh` its mean size of cells, of a number n its inverse
            1/n.
        exact: exact value, or values by name; default: extrapolated from the three finest meshes.

    Raises:
        InputError: fewer than two meshes, no sizes, or a quantity that is not a number, or not a
            finite one on two meshes.

    Example:
        The tip of a bar of length 1 that hangs by its weight, with a uniform displacement in each
        cell:

        >>> def lowest(mesh):
        ...     rope = gx.Cable(mesh, gx.CableLaw(1e3, 0.1), name="rope")
        ...     hung = gx.Scene(rope, gx.Fixed(rope, "start"), gx.Gravity(rope, (9.81, 0.0, 0.0)))
        ...     equilibrium = gx.Equilibrium(hung)
        ...     equilibrium.find()
        ...     return gx.probes.Position(rope.port("end"), "x")(equilibrium) - 1.0
        >>> from gossamer_fx.meshes.line import line
        >>> meshes = [line(comm, [(0, 0, 0), (1, 0, 0)], n) for n in (2, 4, 8)]
        >>> found = gx.analysis.convergence(lowest, meshes=meshes)
        >>> round(1e4 * found.exact["value"], 2)
        4.9
    """
    h = _sizes(meshes, sizes)
    check(
        len(np.unique(h)) == len(h),
        f"convergence: two meshes have the same size, of {h.tolist()}; give different ones.",
    )
    # From the coarsest to the finest, whatever the order in which they were given.
    order = np.argsort(-h, kind="stable")
    # Once without the clock, so that no time of compilation is in the first row.
    quantity(meshes[order[0]])
    rows: list[dict[str, float]] = []
    seconds = []
    for k in order:
        started = time.process_time()
        rows.append(_numbers(quantity(meshes[k])))
        seconds.append(time.process_time() - started)
    names = list(rows[0])
    for row in rows:
        check(
            list(row) == names,
            f"convergence: the quantities are {', '.join(names)} and then {', '.join(row)}; return "
            "the same names.",
        )
    values = {name: np.array([row[name] for row in rows]) for name in names}
    exact_values = {}
    is_extrapolated = {}
    remarks = {}
    for name in names:
        given = exact
        if isinstance(exact, Mapping):
            given = exact.get(name)
        is_extrapolated[name] = False
        words = _left_out(name, h[order], values[name])
        if words:
            LOG.warning("convergence: %s.", words)
        if given is None:
            is_finite = np.isfinite(values[name])
            try:
                exact_values[name] = extrapolated(h[order][is_finite], values[name][is_finite])
                is_extrapolated[name] = True
            except _NoLimit as reason:
                remarks[name] = str(reason)
                LOG.warning("convergence: %s has no errors: %s.", name, reason)
        else:
            assert not isinstance(given, Mapping)
            exact_values[name] = float(given)
    cells = np.array([_cell_count(meshes[k]) for k in order], dtype=float)
    return Convergence(
        sizes=h[order],
        cells=cells,
        seconds=np.array(seconds),
        values=values,
        exact=exact_values,
        is_extrapolated=is_extrapolated,
        remarks=remarks,
    )


def _left_out(name: str, sizes: Array, values: Array) -> str:
    """A clause that names the meshes on which a quantity is not a finite number; empty if it is one
    on all meshes.

    Raises:
        InputError: fewer than two meshes give a finite number.
    """
    bad = np.flatnonzero(~np.isfinite(values))
    if not len(bad):
        return ""
    check(
        len(values) - len(bad) >= 2,
        f"convergence: the quantity {name!r} is {values[bad[0]]} on {len(bad)} of {len(values)} "
        "meshes; return a finite number on two meshes or more.",
    )
    listed = ", ".join(f"{size:.3g}" for size in sizes[bad])
    meshes = "the mesh" if len(bad) == 1 else "the meshes"
    return f"{name} is not finite on {meshes} of h = {listed}, left out of its errors and limit"


def _unit_of(quantity: str) -> str:
    """The unit at the end of a quantity's name, e.g. "m" of "height [m]"; empty without one."""
    found = _UNIT.search(quantity)
    return found[1] if found else ""


class _NoLimit(Exception):
    """Values that (1) cannot be applied to; its words end a sentence."""


def extrapolated(h: Array, values: Array) -> float:
    """The limit of values on meshes of falling size h by (1), from the last three.

    Raises:
        _NoLimit: with the reason: fewer than three meshes, values that are equal, that oscillate or
            do not change less from mesh to mesh, an order outside `MIN_ORDER` to `MAX_ORDER`, one
            that differs from that of the three meshes before, or a limit of the other sign.
    """
    if len(values) < 3:
        raise _NoLimit("two meshes show no limit; give a third one, or `exact`")
    if float(np.ptp(values[-3:])) <= EQUAL_VALUES * float(np.abs(values[-3:]).max()):
        raise _NoLimit(
            f"its last values are all equal ({values[-1]:.6g}), so that they show no order; check "
            "that it is the quantity you mean, or give `exact`"
        )
    order = _order(h[-3:], values[-3:])
    if len(values) > 3:
        # Three values always fit (1): only a fourth one shows whether one power of h dominates.
        before = _order(h[-4:-1], values[-4:-1], advice=f"leave out the coarsest, or {FINER}")
        if abs(before - order) > MAX_ORDER_CHANGE:
            raise _NoLimit(
                f"its order changes from {before:.1f} to {order:.1f}, so that not all meshes are "
                f"in the asymptotic range; leave out the coarsest, or {FINER}"
            )
    finest = float(values[-1])
    change = finest - float(values[-2])
    ratio = float(h[-2] / h[-1])
    limit = finest + change / (ratio**order - 1)
    has_one_sign = bool((values[-3:] * finest > 0).all())
    if has_one_sign and limit * finest < 0 and abs(limit) > MAX_OVERSHOOT * abs(finest):
        raise _NoLimit(
            f"all its values have one sign but the extrapolated limit {limit:.3g} has the other, "
            f"so that the meshes are not in the asymptotic range; {FINER}"
        )
    return limit


def _order(h: Array, values: Array, advice: str = FINER) -> float:
    """The order p of three values on meshes of falling size h by (1).

    Raises:
        _NoLimit: there is none, with the reason.
    """
    first = float(values[1] - values[0])
    second = float(values[2] - values[1])
    if first * second < 0:
        raise _NoLimit(
            f"its values oscillate ({_listed(values)}), so that the meshes are not in the "
            f"asymptotic range; {advice}"
        )
    if second == 0:
        raise _NoLimit(
            f"two of its values are equal ({_listed(values)}), so that they show no order; {advice}"
        )
    # Imported here: SciPy's optimisation is needed by few scenes.
    from scipy.optimize import brentq

    coarse = float(h[0] / h[1])
    fine = float(h[1] / h[2])

    def excess(p: float) -> float:
        """Of the ratio of changes that an order p gives, over the observed one."""
        return (coarse**p - 1) / (1 - fine**-p) - first / second

    low = MIN_ORDER
    high = MAX_ORDER
    if excess(low) > 0 or excess(high) < 0:
        side = f"below {MIN_ORDER:g}"
        if excess(high) < 0:
            side = f"above {MAX_ORDER:g}"
        raise _NoLimit(
            f"its values ({_listed(values)}) show an order {side}, so that the meshes are not in "
            f"the asymptotic range; {advice}"
        )
    return float(brentq(excess, low, high))


def _listed(values: Array) -> str:
    """Values in the order of the meshes, for a message."""
    return ", ".join(f"{value:.4g}" for value in values)


def _sizes(meshes: Sequence[Any], given: Sequence[float]) -> Array:
    """Return the size h of the cells of each mesh, (m,).

    Args:
        meshes: m meshes, or numbers of cells n, whose size is 1/n.
        given: sizes (m,) that the user gave; if there are any they are returned.

    Raises:
        InputError: another number of sizes than of meshes, one that is not positive, or a mesh
            whose size is not known.
    """
    if len(given):
        found = np.asarray(given, dtype=float)
        return found
    sizes_of_meshes = []
    for mesh in meshes:
        if isinstance(mesh, Mesh):
            sizes_of_meshes.append(_cell_size(mesh))
        elif isinstance(mesh, int | float) and not isinstance(mesh, bool) and mesh > 0:
            sizes_of_meshes.append(1.0 / mesh)
        else:
            raise InputError(
                f"convergence: the size of {mesh!r} is not known; give sizes, or meshes as Mesh or "
                "numbers of cells."
            )
    return np.array(sizes_of_meshes)


def _cell_size(mesh: Mesh) -> float:
    """Mean size of the cells of a mesh [m]."""
    count = _cell_count(mesh)
    own = float(sizes(corner_points(mesh.domain)).sum())
    mean = mesh.comm.allreduce(own, op=MPI.SUM) / count
    if mesh.domain.topology.dim == 2:
        # The side of a square of two triangles.
        return math.sqrt(2 * mean)
    return mean


def _cell_count(mesh: Any) -> int:
    """Number of cells of a mesh, 0 if that is not known."""
    if not isinstance(mesh, Mesh):
        return 0
    topology = mesh.domain.topology
    return int(topology.index_map(topology.dim).size_global)


def _numbers(found: Any) -> dict[str, float]:
    """What a quantity returned, by name; a single number has the name `ONLY`.

    Raises:
        InputError: it is not a number, or there is none.
    """
    if not isinstance(found, Mapping):
        found = {ONLY: found}
    numbers = {}
    for name, value in found.items():
        try:
            numbers[str(name)] = float(value)
        except (TypeError, ValueError):
            raise InputError(
                f"convergence: the quantity {name!r} is {value!r}; return a number."
            ) from None
    check(bool(numbers), "convergence: the quantity has no number; return one, or several by name.")
    return numbers

"""Colours of films: by their state, by their groups, or on a scale of numbers; readable with any
colour vision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED
from gossamer_fx.records.fields.film_states import STATES
from gossamer_fx.records.fields.units import LINE_FIELDS, NAMES, UNITS, scaled
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.shapes import Integers

# Blue, orange, light grey: told apart with any colour vision, and in print by their brightness.
STATE_COLOURS = {SLACK: (0.18, 0.49, 0.75), WRINKLED: (0.96, 0.65, 0.14), TAUT: (0.87, 0.88, 0.89)}
# Of groups and layers, after M. Okabe and K. Ito, Color universal design (2008); repeated beyond
# the seventh.
GROUP_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")

_BINS = 128
# Part of the larger sign below which the other sign is left out of a scale: a film in tension has
# small compressions.
_NEGLIGIBLE = 0.05
# Percentage of the values beyond either end of a scale, so that single cells do not decide it.
_TAILS = 0.5
_SAMPLES = 24  # recorded states that decide on a scale, and on a camera for a whole run


@dataclass(frozen=True)
class Scale:
    """Colours for numbers from `low` to `high`.

    If both signs matter they go from blue over light yellow at zero to red, else from dark to
    bright.
    """

    name: str
    unit: str
    low: float
    high: float

    @property
    def signed(self) -> bool:
        return self.low < 0 < self.high

    @property
    def table(self) -> Array:
        """Red, green and blue in [0, 1] (bins, 3)."""
        from matplotlib import colormaps

        name = "RdYlBu_r" if self.signed else "viridis"
        colours: Array = colormaps[name](np.linspace(0, 1, _BINS))[:, :3]
        return colours

    def bins(self, values: Array) -> Integers:
        """Rows of the table for values (n,)."""
        width = self.high - self.low
        part = np.zeros_like(values)
        if width > 0:
            part = (values - self.low) / width
        found: Integers = np.rint(part.clip(0, 1) * (_BINS - 1)).astype(np.int64)
        return found

    @property
    def label(self) -> tuple[float, str]:
        """Factor of the unit in which the numbers are written, and the name with that unit."""
        if not self.unit:
            return 1e-3, f"{self.name} [10⁻³]"
        factor, prefix = scaled(max(abs(self.low), abs(self.high)))
        return factor, f"{self.name} [{prefix}{self.unit}]"


def scale(field: str, samples: Sequence[Array]) -> Scale:
    """The scale of colours on which samples of a field are seen best; symmetric if both signs
    matter.

    It runs from the 0.5 to the 99.5 percentile, and from zero where one sign is negligible.
    """
    values = np.concatenate([np.zeros(0), *samples])
    values = values[np.isfinite(values)]
    low = 0.0
    high = 0.0
    if values.size:
        low, high = np.percentile(values, [_TAILS, 100 - _TAILS])
    larger = max(abs(low), abs(high))
    if low < -_NEGLIGIBLE * larger and high > _NEGLIGIBLE * larger:
        low = -larger
        high = larger
    elif high > -low:
        low = 0.0
    else:
        high = 0.0
    return Scale(NAMES.get(field, field), UNITS.get(field, ""), float(low), float(high))


@dataclass(frozen=True)
class Colouring:
    """How triangles are coloured.

    Attributes:
        key: the names and colours of kinds, or a scale.
        table: red, green and blue in [0, 1] (kinds, 3) of each kind.
        missing: kind of triangles of films that do not have the field.
    """

    key: dict[str, Any] | Scale
    table: Array
    missing: int = 0

    def kinds(self, values: Array) -> Integers:
        """Rows of the table for values (n,) of the field; what is not a number is missing."""
        if isinstance(self.key, Scale):
            return self.key.bins(np.nan_to_num(values))
        known = np.where(np.isfinite(values), values, self.missing)
        found: Integers = np.rint(known).astype(np.int64).clip(0, len(self.table) - 1)
        return found


def colouring(run: RunReader, field: str) -> Colouring:
    """The colours of a field, on one scale for the whole run."""
    run.check_field(field)
    if field == "group":
        key = dict(zip(run.groups, GROUP_COLOURS, strict=False))
        return Colouring(key, group_table(len(run.groups)))
    if field == "state" or (not run.films and field not in LINE_FIELDS):
        return by_state(bool(run.films))
    samples = [
        values.mean(axis=1) for record in sampled(run) for values in run.values(field, record)
    ]
    found = scale(field, samples)
    return Colouring(found, found.table)


def by_state(has_films: bool) -> Colouring:
    """The colours of slack, wrinkled and taut film; films that have no states are drawn as taut."""
    table = np.array([STATE_COLOURS[state] for state in sorted(STATE_COLOURS)])
    key = {name: STATE_COLOURS[STATES[name]] for name in ("taut", "wrinkled", "slack")}
    return Colouring(key if has_films else {}, table, missing=TAUT)


def group_table(groups: int) -> Array:
    """Red, green and blue in [0, 1] of groups (groups, 3), of one at least."""
    from matplotlib.colors import to_rgb

    colours = [to_rgb(GROUP_COLOURS[k % len(GROUP_COLOURS)]) for k in range(max(groups, 1))]
    return np.array(colours)


def sampled(run: RunReader) -> list[int]:
    """Numbers of recorded states that are evenly spread over the run."""
    last = len(run.times) - 1
    return sorted({round(k) for k in np.linspace(0, last, min(_SAMPLES, last + 1))})


def default_field(run: RunReader) -> str:
    """The field that shows most: the amplitude of a mode, the state of films, or else the first
    one.
    """
    from gossamer_fx.core.checks.errors import check

    known = run.known_fields()
    check(bool(known), f"The run in '{run.folder}' has no bodies on a mesh; plot its curves.")
    for field in ("mode_amplitude", "state"):
        if field in known:
            return field
    return known[0]

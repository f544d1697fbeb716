"""Colours of films: by their state, by their groups, or on a scale of numbers; readable with any
colour vision.

One rule holds in pictures, animations, reports and the view: a number has the colour of the bar,
darkened where a surface turns away from the eye; what has no value is grey; slack film is hatched.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import below
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED
from gossamer_fx.records.fields.film_states import STATES
from gossamer_fx.records.fields.units import LINE_FIELDS, NAMES, UNITS, scaled_unit
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.shapes import Integers, Shape

# Blue, orange, light grey: told apart with any colour vision, and in print by their brightness.
STATE_COLOURS = {SLACK: (0.18, 0.49, 0.75), WRINKLED: (0.96, 0.65, 0.14), TAUT: (0.87, 0.88, 0.89)}
# Of groups and layers, after M. Okabe and K. Ito, Color universal design (2008); repeated beyond
# the seventh.
GROUP_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")

# Of what lacks the field: darker than taut film, and on no scale.
MISSING_COLOUR = (0.70, 0.70, 0.70)

# Twice as many and the missing colour fit into a byte: the view has each with and without hatching.
_BINS = 126
# Part of the larger sign below which the other sign is left out of a scale: a film in tension has
# small compressions.
_NEGLIGIBLE = 0.05
# Percentage of the values that are beyond either end of a scale, if they reach farther than
# _TAIL_RATIO of the range between the ends: single cells at a corner do not decide it.
_TAIL_PERCENTAGE = 0.5
_TAIL_RATIO = 0.25
_DECADES = 1e-4  # least number over the largest of a logarithmic scale, if none is given
_SAMPLES = 24  # recorded states that decide on a scale, and on a camera for a whole run


@check_arguments(below("low", "high"))
@dataclass(frozen=True)
class Limits:
    """The numbers at the ends of a scale of colours, and what is coloured by it.

    Without limits the scale has the least and the largest value of all pictures, or less where few
    values reach far beyond the others.  Values beyond its ends are marked at the bar.

    Args:
        low: number at the lower end, in SI units; None: from the values.
        high: number at the upper end, in SI units; None: from the values.
        part: name of the only film or line that is coloured, by its own values; the others are
            grey.
        each_time: whether each picture has its own limits, which its caption says.
        log: whether colours follow the logarithm; numbers below the scale have its lowest colour.

    Raises:
        InputError: numbers that do not ascend, or are not positive for a logarithm.

    Example:
        >>> limits = gx.plot.Limits(low=0.0, high=2e-4)
        >>> picture = folder / "limits.png"
        >>> gx.plot.strip(recorded, "displacement", path=picture, limits=limits)
    """

    low: float | None = None
    high: float | None = None
    part: str = ""
    each_time: bool = False
    log: bool = False

    def __post_init__(self) -> None:
        given = [value for value in (self.low, self.high) if value is not None]
        check(
            not self.log or all(value > 0 for value in given),
            f"Limits: a logarithmic scale from {self.low!r} to {self.high!r}; give positive "
            "numbers.",
        )

    @property
    def needs_numbers(self) -> bool:
        """Whether only a field of numbers can have them."""
        return self.low is not None or self.high is not None or self.each_time or self.log


NO_LIMITS = Limits()


@dataclass(frozen=True)
class Scale:
    """Colours for numbers from `low` to `high`.

    If both signs matter they go from blue over light yellow at zero to red, else from dark to
    bright.

    Attributes:
        least: of the values that are drawn; below `low` the bar has a mark.
        largest: of the values that are drawn; above `high` the bar has a mark.
    """

    name: str
    unit: str
    low: float
    high: float
    least: float
    largest: float
    log: bool = False

    @property
    def signed(self) -> bool:
        """Whether zero is within the scale, and not at its end."""
        return self.low < 0 < self.high

    @property
    def table(self) -> Array:
        """Red, green and blue in [0, 1] (bins, 3) of equal parts of the bar, from low to high."""
        from matplotlib import colormaps

        name = "viridis"
        first = 0.0
        last = 1.0
        if self.signed:
            # Zero is in the middle of the colours, also if the limits are not symmetric.
            name = "RdYlBu_r"
            larger = max(-self.low, self.high)
            first = 0.5 + 0.5 * self.low / larger
            last = 0.5 + 0.5 * self.high / larger
        return colormaps[name](np.linspace(first, last, _BINS))[:, :3]

    def parts(self, values: Array) -> Array:
        """Positions of values (n,) on the bar, from 0 to 1; those beyond have its ends."""
        low = self.low
        high = self.high
        if self.log:
            values = np.log(np.maximum(values, low))
            low = math.log(low)
            high = math.log(high)
        if high == low:
            return np.zeros_like(values)
        return ((values - low) / (high - low)).clip(0, 1)

    @property
    def clipped(self) -> tuple[bool, bool]:
        """Whether values are below and above the bar by more than half of a colour."""
        half = 0.5 / _BINS * (self.high - self.low)
        return self.least < self.low - half, self.largest > self.high + half

    @property
    def label(self) -> tuple[float, str]:
        """Factor of the unit in which the numbers are written, and the name with that unit."""
        factor, unit = scaled_unit(max(abs(self.low), abs(self.high)), self.unit)
        return factor, f"{self.name} [{unit}]" if unit else self.name

    @property
    def multiple(self) -> str:
        """The unit of the label; empty for pure numbers."""
        return scaled_unit(max(abs(self.low), abs(self.high)), self.unit)[1]

    @property
    def ends(self) -> tuple[str, str]:
        """The numbers at both ends of the bar in the unit of the label."""
        factor, _ = self.label
        return f"{self.low / factor:.4g}", f"{self.high / factor:.4g}"

    @property
    def beyond(self) -> str:
        """Words about the values beyond the ends of the bar; empty if there are none."""
        factor, _ = self.label
        below, above = self.clipped
        words = []
        if below:
            words.append(f"least {self.least / factor:.4g}")
        if above:
            words.append(f"largest {self.largest / factor:.4g}")
        return ", ".join(words)


def scale(name: str, samples: Array, extremes: tuple[float, float], limits: Limits) -> Scale:
    """The scale of colours for samples (n,) of a field; symmetric if both signs matter.

    It has the extremes, or the 0.5 and 99.5 percentiles if the values beyond them reach far, and
    begins at zero where one sign is negligible.

    Args:
        extremes: least and largest value of the pictures.
        limits: those that are given hold.
    """
    least, largest = extremes
    if limits.log:
        samples = samples[samples > 0]
    low = 0.0
    high = 0.0
    if samples.size:
        low, high = np.percentile(samples, [_TAIL_PERCENTAGE, 100 - _TAIL_PERCENTAGE])
        tail = _TAIL_RATIO * (high - low)
        if low - tail <= least and not limits.log:
            low = least
        if largest <= high + tail:
            high = largest
    if not limits.log:
        low, high = _about_zero(low, high)
    if limits.high is not None:
        high = limits.high
    if limits.log:
        low = max(low, _DECADES * high)
        check(
            high > 0,
            f"Limits: the field '{name}' has no positive values for a logarithm; leave out log.",
        )
    if limits.low is not None:
        low = limits.low
    check(
        low <= high,
        f"Limits: the colours of '{name}' would go from {low:.6g} to {high:.6g}; give both limits.",
    )
    return Scale(
        name=NAMES.get(name, name),
        unit=UNITS.get(name, ""),
        low=float(low),
        high=float(high),
        least=least,
        largest=largest,
        log=limits.log,
    )


def _about_zero(low: float, high: float) -> tuple[float, float]:
    """Limits that are symmetric if both signs matter, else begin or end at zero."""
    larger = max(abs(low), abs(high))
    if low < -_NEGLIGIBLE * larger and high > _NEGLIGIBLE * larger:
        return -larger, larger
    if high > -low:
        return 0.0, high
    return low, 0.0


@dataclass(frozen=True)
class Colouring:
    """How the triangles and lines of a run are coloured by a field.

    Attributes:
        field: its name.
        table: red, green and blue in [0, 1] (kinds + 1, 3); the last row is of what has no value.
        names: colours of kinds by name, for the legend; empty for numbers.
        scale: of numbers; None for kinds.
        scales: of each drawn state by its number, if each has its own.
        part: name of the only body that is coloured; empty: all are.
        has_missing: whether the legend says what is grey.
        has_slack: whether the legend says what is hatched.
    """

    field: str
    table: Array
    names: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    scale: Scale | None = None
    scales: Mapping[int, Scale] = dataclasses.field(default_factory=dict)
    part: str = ""
    has_missing: bool = False
    has_slack: bool = False

    def kinds(self, values: Array) -> Integers:
        """Rows of the table for values (n,) of the field."""
        count = len(self.table) - 1
        is_known = np.isfinite(values)
        known = np.where(is_known, values, 0.0)
        if self.scale is None:
            # Groups beyond the last colour have the first ones again.
            rows = np.rint(known) % count
        else:
            rows = np.rint(self.scale.parts(known) * (count - 1))
        return np.where(is_known, rows, count).astype(np.int64)

    def at(self, record: int) -> Colouring:
        """The colours of one state, which may have its own limits."""
        return replace(self, scale=self.scales.get(record, self.scale))

    def shape(self, run: RunReader, record: int) -> Shape:
        """The scene in a recorded state in these colours."""
        return run.shape(record, self.field, self.at(record).kinds, self.part)

    def caption(self, record: int) -> str:
        """Words about the limits of a state that has its own; else empty."""
        if record not in self.scales:
            return ""
        scale = self.scales[record]
        low, high = scale.ends
        beyond = f" ({scale.beyond})" if scale.beyond else ""
        return f", {low} to {high} {scale.multiple}".rstrip() + beyond


def colouring(
    run: RunReader,
    field: str,
    limits: Limits = NO_LIMITS,
    records: Sequence[int] = (),
) -> Colouring:
    """The colours of a field, on one scale for the whole run unless each time has its own.

    Args:
        records: numbers of the states that are drawn, whose extremes are known besides those of
            some that are evenly spread over the run.

    Raises:
        InputError: an unknown field or part, or limits for a field without numbers.
    """
    run.check_field(field)
    run.check_part(field, limits.part)
    is_state = field == "state" or (not run.films and field not in LINE_FIELDS)
    check(
        not limits.needs_numbers or not (is_state or field == "group"),
        f"Limits: the field '{field}' is not a scale of numbers; leave out its limits.",
    )
    seen = sorted({*sampled(run), *records})
    found = by_state(bool(run.films))
    if field == "group":
        named = dict(zip(run.groups, GROUP_COLOURS, strict=False))
        rows = group_table(min(len(run.groups), len(GROUP_COLOURS)))
        found = Colouring(field, _with_missing(rows), named)
    elif not is_state:
        found = _by_number(run, field, limits, records, seen)
    colours_films = bool(run.films) and field not in LINE_FIELDS
    return replace(
        found,
        part=limits.part,
        has_missing=colours_films
        and any(not run.has_field(name, field, limits.part) for name in run.films),
        has_slack=colours_films
        and field != "state"
        and any(run.has_slack(one, limits.part) for one in seen),
    )


def _by_number(
    run: RunReader,
    field: str,
    limits: Limits,
    records: Sequence[int],
    seen: Sequence[int],
) -> Colouring:
    """The colours of a field of numbers.

    Args:
        records: numbers of the states that are drawn.
        seen: these and others, whose extremes count.
    """
    chosen = set(sampled(run))
    samples = [np.zeros(0)]
    scales = {}
    least = math.inf
    largest = -math.inf
    for record in seen:
        values = [one.ravel() for one in run.values(field, record, limits.part)]
        at_corners = np.concatenate([np.zeros(0), *values])
        at_corners = at_corners[np.isfinite(at_corners)]
        if not at_corners.size:
            continue
        extremes = (float(at_corners.min()), float(at_corners.max()))
        least = min(least, extremes[0])
        largest = max(largest, extremes[1])
        if record in chosen:
            samples.append(at_corners)
        if limits.each_time and record in records:
            scales[record] = scale(field, at_corners, extremes, limits)
    if least > largest:
        # No part has a value in any of the states.
        least = 0.0
        largest = 0.0
    found = scale(field, np.concatenate(samples), (least, largest), limits)
    return Colouring(field, _with_missing(found.table), scale=found, scales=scales)


def by_state(has_films: bool) -> Colouring:
    """The colours of slack, wrinkled and taut film; films that have no states are grey."""
    table = np.array([STATE_COLOURS[state] for state in sorted(STATE_COLOURS)])
    names = {name: STATE_COLOURS[STATES[name]] for name in ("taut", "wrinkled", "slack")}
    return Colouring("state", _with_missing(table), names if has_films else {})


def _with_missing(table: Array) -> Array:
    """A table (kinds, 3) of colours with the row of what has no value."""
    return np.concatenate([table, [MISSING_COLOUR]])


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
    known = run.known_fields()
    check(
        bool(known),
        f"The run in '{run.folder}' has no bodies on a mesh; plot its curves (--curves).",
    )
    for field in ("mode_amplitude", "state"):
        if field in known:
            return field
    return known[0]

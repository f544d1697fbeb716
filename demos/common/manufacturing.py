"""Manufacturing errors of a folded tube: positions and angles of its folds, its diameter and its
thickness.

A seed stands for one specimen.  Errors are normally distributed, and cut at `LARGEST` standard
deviations: worse specimens do not pass the inspection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

import gossamer_fx as gx
from gossamer_fx.extend import Array, Bent, check

# Errors over their standard deviation.
LARGEST = 2.0


@dataclass(frozen=True)
class Scatter:
    """Standard deviations of the manufacturing errors of a tube.

    Attributes:
        fold_position: of each fold along the tube [m].
        fold_angle: of each fold [rad].
        diameter: of the tube, over its nominal value; below 1/`LARGEST`.
        thickness: of the film of each panel, over its nominal value; below 1/`LARGEST`.
    """

    fold_position: float = 0.0
    fold_angle: float = 0.0
    diameter: float = 0.0
    thickness: float = 0.0


@dataclass(frozen=True)
class Specimen:
    """One tube as it was made.

    Attributes:
        fold_shifts: of each fold along the tube (panels - 1,) [m].
        angle_errors: of each fold (panels - 1,) [rad].
        diameter_ratio: diameter over its nominal value.
        thickness_ratios: thickness of each panel (panels,) over its nominal value.
    """

    fold_shifts: tuple[float, ...]
    angle_errors: tuple[float, ...]
    diameter_ratio: float
    thickness_ratios: tuple[float, ...]


def draw_specimen(seed: int, panels: int, scatter: Scatter) -> Specimen:
    """The specimen of a seed; that of the seed 0 is as drawn, without errors."""
    if seed == 0:
        scatter = Scatter()
    # One generator for a specimen, so that a seed names it on every machine.
    random = np.random.default_rng(seed)

    def errors(deviation: float, count: int) -> tuple[float, ...]:
        """Errors (count,) of one kind."""
        drawn = random.standard_normal(count)
        return tuple((deviation * np.clip(drawn, -LARGEST, LARGEST)).tolist())

    # The order of these lines is that of the random numbers: another one gives other specimens.
    fold_shifts = errors(scatter.fold_position, panels - 1)
    angle_errors = errors(scatter.fold_angle, panels - 1)
    (diameter_error,) = errors(scatter.diameter, 1)
    thickness_errors = errors(scatter.thickness, panels)
    return Specimen(
        fold_shifts,
        angle_errors,
        1 + diameter_error,
        tuple(1 + error for error in thickness_errors),
    )


def stations(length: float, panels: int, shifts: Sequence[float] = ()) -> Array:
    """Ends of the panels (panels + 1,) [m] along a tube whose folds are shifted (panels - 1,) [m].

    Raises:
        InputError: a panel would have no length.
    """
    ends = np.linspace(0.0, length, panels + 1)
    if len(shifts):
        ends[1:-1] += shifts
    check(
        bool((np.diff(ends) > 0).all()),
        f"The folds of a tube of {length:g} m are at {ends[1:-1].tolist()} m; give a smaller "
        "scatter of their positions.",
    )
    return ends


def move_rows(mesh: gx.Mesh, length: float, ends: Array) -> gx.Mesh:
    """Move the rows of edges of a tube of equal panels so that its panels end at `ends` [m];
    returns the mesh.

    The mesh is changed in place: call it before a film is made on it.
    """
    equal = np.linspace(0.0, length, len(ends))
    x = mesh.domain.geometry.x
    # Each panel is stretched uniformly, so that its rows remain straight.
    x[:, 0] = np.interp(x[:, 0], equal, ends)
    return mesh


@dataclass(frozen=True)
class UnevenZigzag(gx.fold.Zigzag):
    """An accordion whose folds have errors of position and angle, see `gx.fold.Zigzag`.

    Args:
        shifts: of each fold along the strip (panels - 1,) [m].
        angle_errors: added to the angle of each fold (panels - 1,) [rad].  They add up along the
            strip: what is behind a fold is turned by its error.
    """

    called: ClassVar[str] = "UnevenZigzag"
    _: KW_ONLY
    shifts: tuple[float, ...] = ()
    angle_errors: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check the arguments.

        Raises:
            InputError: see `gx.fold.Zigzag`; also errors of another number of folds, or folds with
                a radius.
        """
        super().__post_init__()
        # No number of errors stands for folds without errors.
        for name in ("shifts", "angle_errors"):
            count = len(getattr(self, name))
            self._check(
                count in (0, self.panels - 1),
                f"{name} has {count} numbers; give one for each of the {self.panels - 1} folds.",
            )
        self._check(self.bends == 1, f"bends is {self.bends!r}; only sharp folds have errors.")

    @cached_property
    def _ends(self) -> Array:
        """Ends of the panels (panels + 1,) [m]."""
        return stations(self.length, self.panels, self.shifts)

    @cached_property
    def bent(self) -> Bent:
        """The bent line of the strip."""
        folds = np.full(self.panels - 1, 2 * self.angle)
        if self.angle_errors:
            folds += self.angle_errors
        # The first panel rises; folds turn down and up in turn.
        sense = -((-1.0) ** np.arange(self.panels - 1))
        rise = self.angle + np.concatenate([[0.0], np.cumsum(sense * folds)])
        return Bent(self._ends[1:-1], rise)

    def ajar(self) -> UnevenZigzag:
        """The same fold, open enough to distinguish mountains and valleys."""
        # Errors are small against the open folds; they would not be against folds that are scaled.
        return replace(self, angle=self.angle / 2, angle_errors=())

    def _panel_of(self, X: Array) -> Array:
        """Number of the panel (n,) and the share of it that lies before points X (n, 3), from 0 to
        `panels`."""
        return np.interp(X[:, 0], self._ends, np.arange(self.panels + 1.0))

    def thickness(self, X: Array) -> Array:
        """Half of the distance (n,) [m] of the sheets: a pillow in each panel."""
        if not self.opening:
            return np.zeros(len(X))
        along = np.abs(np.sin(np.pi * self._panel_of(X)))
        return self.opening * along * self._across(X)

    def shift(self, X: Array) -> Array:
        """Shift (n,) [m] of the upper sheet along z: `lift` at all folds, growing from zero at the
        ends."""
        if not self.lift:
            return np.zeros(len(X))
        panel = self._panel_of(X)
        from_end = np.minimum(panel, self.panels - panel)
        return self.lift * np.clip(from_end, 0, 1) * self._across(X)

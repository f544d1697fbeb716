"""Probes of films: areas by state, largest stress."""

from __future__ import annotations

from typing import Annotated, Literal

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.fields.body_shape import At
from gossamer_fx.records.fields.film_states import STATES, AreaFractions
from gossamer_fx.records.fields.largest_stress import StressSearch
from gossamer_fx.solve.view import StateView


class _FilmArea:
    """The area of a film in a state, or its share."""

    def __init__(
        self,
        body: Membrane,
        state: Literal["slack", "wrinkled", "taut"],
        *,
        group: str = "",
        at: At = "mean",
    ) -> None:
        self.state = state
        self._areas = AreaFractions([body], at, group)


@check_arguments
class AreaFraction(_FilmArea):
    """Share of a film's reference area that is slack, wrinkled or taut.

    A part that is taut over half of the last step counts by half.

    Args:
        body: the film.
        state: "slack", "wrinkled" or "taut".
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".

    Raises:
        InputError: the state is unknown; when called: the group has no cells.

    Example:
        >>> wrinkled = gx.probes.AreaFraction(film, "wrinkled")
    """

    def __call__(self, run: StateView) -> float:
        """The share in the state of a run, 0 to 1."""
        return float(self._areas(run.system)[STATES[self.state]])


@check_arguments
class StateArea(_FilmArea):
    """Reference area [m²] of a film that is slack, wrinkled or taut; arguments as `AreaFraction`.

    Args:
        body: the film.
        state: "slack", "wrinkled" or "taut".
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".

    Raises:
        InputError: the state is unknown; when called: the group has no cells.

    Example:
        >>> taut = gx.probes.StateArea(film, "taut", group="film")
        >>> round(taut(gx.Equilibrium(gx.Scene(film))), 12)
        1.0
    """

    unit = "m²"

    def __call__(self, run: StateView) -> float:
        """The area [m²] in the state of a run."""
        return float(self._areas.areas(run.system)[STATES[self.state]])


@check_arguments
class LargestStress:
    """Largest principal stress [Pa] in a film, or its ratio to the strength of the material; see
    `gx.analysis.largest_stress`.

    Args:
        film: the film.
        limit: [Pa], e.g. `KAPTON_HN.yield_stress`; with it the probe returns the ratio.
        group: of cells of the film's mesh; empty: the whole film.
        at: "mean" over the last step, or "end".

    Raises:
        InputError: a limit that is not positive; when called: the group has no cells.

    Example:
        >>> stress = gx.probes.LargestStress(film, limit=69e6)
        >>> abs(stress(gx.Equilibrium(gx.Scene(film)))) < 1e-9
        True
    """

    def __init__(
        self,
        film: Membrane,
        *,
        limit: Annotated[float, positive("Pa")] | None = None,
        group: str = "",
        at: At = "mean",
    ) -> None:
        self.limit = limit
        self.unit = "Pa" if limit is None else "1"
        self._search = StressSearch(film, group, at)

    def __call__(self, run: StateView) -> float:
        """The stress [Pa], or its ratio to the limit, in the state of a run."""
        stress = self._search(run.system, self.limit).stress
        return stress / self.limit if self.limit else stress

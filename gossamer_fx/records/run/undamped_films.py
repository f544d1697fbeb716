"""A warning of films that vibrate under the pressure of gas, and that nothing damps.

Problem.  The midpoint rule conserves energy: a film without damping that gas has shaken vibrates
without end.  Its strain energy is then many times that of the film at rest under the same pressure;
the vibration holds folds open and film slack, and opening times and stiffness are not those of any
real film.  The energy balance closes all the same.

Estimate.  At rest the trace N of the tension [N/m] of a closed film of area A has ∫N dA = 3 p V,
from the work of a uniform growth.  With the mean of N along one direction, as in a wrinkled film,
the strain energy is

    U = (3 p V)²/(2 E t A).

That of a sphere is a third of it, of a long tube 0.5 to 0.8, of a square airbag 1.6 times.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gossamer_fx.core.mesh.quality import corner_points, sizes
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.materials.film import IsotropicFilm
from gossamer_fx.mechanics.terms.element_energies import ViscousDissipation
from gossamer_fx.solve.view import chamber_states

if TYPE_CHECKING:
    from gossamer_fx.solve.system.system import System
    from gossamer_fx.solve.system.totals import Totals

LOGGER = logging.getLogger("gossamer_fx")

# Strain energy over U from which a film is warned of.
MAX_RATIO = 5.0


class UndampedFilms:
    """Warns, once for each film, at the end of a run.

    Args:
        system: the compiled scene.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        damped = {
            term.body for term in system.unknowns.terms if isinstance(term, ViscousDissipation)
        }
        # (E t A) [N m] of each film that is watched.
        self._stiffness: dict[Membrane, float] = {}
        for state in chamber_states(system).values():
            for film in _films_of(state.chamber):
                if film in damped or film in self._stiffness:
                    continue
                if isinstance(film.law, IsotropicFilm):
                    own = float(sizes(corner_points(film.mesh.domain)).sum())
                    area = system.comm.allreduce(own)
                    self._stiffness[film] = film.law.E * film.law.thickness * area

    def warn(self, first: Totals, now: Totals) -> None:
        """Warn of films whose strain energy is too large for the pressure of their gas, by the
        energies at the start of the run and now."""
        for film, ratio in self._ratios(first, now).items():
            if ratio < MAX_RATIO:
                continue
            del self._stiffness[film]
            if self._system.comm.rank == 0:
                LOGGER.warning(
                    "'%s': its strain energy is %.2g times that of film which bears the pressure "
                    "of its gas at rest, and nothing damps it: it vibrates, which holds folds open "
                    "and results may depend on; damp it, e.g. by gx.loads.flat_damping(film, "
                    "loss_factor=0.01, band=(1.0, 1e5)), and see what changes.",
                    film.name,
                    ratio,
                )

    def _ratios(self, first: Totals, now: Totals) -> dict[Membrane, float]:
        """Strain energy of each film that is watched, less that of the start, over U."""
        work = dict.fromkeys(self._stiffness, 0.0)
        for state in chamber_states(self._system).values():
            films = _films_of(state.chamber)
            outside = getattr(state.chamber, "outside", None)
            gauge = state.pressure - (outside.pressure if outside is not None else 0.0)
            volume = state.volume - getattr(state.chamber, "dead_volume", 0.0)
            for film in films:
                if film in work:
                    work[film] += 3 * gauge * volume / len(films)
        ratios = {}
        for film, stiffness in self._stiffness.items():
            gained = now.stored.get(film.name, 0.0) - first.stored.get(film.name, 0.0)
            at_rest = work[film] ** 2 / (2 * stiffness)
            if at_rest > 0:
                ratios[film] = gained / at_rest
        return ratios


def _films_of(chamber: Any) -> Sequence[Membrane]:
    """The films that bound a chamber; none of a tank."""
    enclosure = getattr(chamber, "enclosure", None)
    return enclosure.films if enclosure is not None else ()

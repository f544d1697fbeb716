"""An equilibrium as a result: whether it is regular, stable and unique, and the warnings."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field

from gossamer_fx.analysis.statics.continuation import Search
from gossamer_fx.analysis.statics.prestress import (
    MAX_NAMED_PARTS,
    ReachedPrestress,
    lost_prestress_words,
)
from gossamer_fx.analysis.vibration.rigid_motions import (
    FreeMotions,
    free_motions,
    listed,
    parts,
)
from gossamer_fx.analysis.vibration.spectrum import (
    UNKNOWN,
    active_multipliers,
    count_beyond_round_off,
    count_unstable,
    symmetric_on_constraints,
)
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.system.totals import Totals

# Loads over the estimated round-off of the inner forces, below which the equilibrium may not show
# them.  Cantilevers of thin plates were right down to 6e-6, and had not moved at 5e-6 and less.
LOST_LOAD = 1e-4

LOG = logging.getLogger("gossamer_fx")


@check_arguments
@dataclass(frozen=True, repr=False)
class EquilibriumResult:
    """An equilibrium and how it was found.

    Attributes:
        residual: unbalanced force over that of loads and supports; without loads over a thousand
            times the round-off of the inner forces.
        iterations: Newton iterations, including those of failed pseudo-steps.
        steps: pseudo-steps, including failed ones.
        cuts: failed pseudo-steps.
        seconds: CPU time of this rank [s], without compilation.
        totals: energies.  The kinetic energy is zero; `supplied` is the work of loads and supports
            along the path of the continuation, which is exact for dead loads and prescribed
            pressure; wind does not count.
        regular: whether Newton's iteration converges without inertia and the tangent is not
            singular.
        free: rigid motions that no support or load resists, of each part that moves independently;
            the equilibrium is unique at most up to these.
        slack: such motions of parts whose bodies are held against them, but have no stiffness
            across, as film and cables without tension.
        unstable: number of negative eigenvalues of the stiffness, also where something moves
            freely: zero in a stable equilibrium; -1 where it is not known: the tangent is singular
            for another reason, gas flows, or loads make the stiffness unsymmetric.
        within_tolerance: whether the residual reached the tolerance of the search, or without loads
            the round-off of the inner forces.  Otherwise that round-off has ended it earlier.
        prestress: of the films, cables and beams that have one, by their names: which stress or
            tension was asked for, and which is left.

    An equilibrium that is not regular, not stable, not within its tolerance, or in which a part has
    less than 90 % of its prestress, is also reported by a warning in the log.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> result = gx.Equilibrium(gx.Scene(weight, spring)).find()
        >>> result.free
        ()
        >>> result.residual < 1e-8
        True
    """

    residual: float
    iterations: int
    steps: int
    cuts: int
    seconds: float
    totals: Totals
    regular: bool
    free: tuple[str, ...]
    unstable: int = UNKNOWN
    within_tolerance: bool = True
    prestress: Mapping[str, ReachedPrestress] = field(default_factory=dict)
    slack: tuple[str, ...] = ()

    def summary(self) -> str:
        """Residual, iterations and time, and what falls short, in words."""
        words = [
            f"residual {self.residual:.1e}",
            f"{self.iterations} iterations",
            f"{self.seconds:.2g} s",
        ]
        if not self.within_tolerance:
            words.append("not within its tolerance")
        if self.free:
            words.append(f"nothing resists {listed(self.free)}")
        if self.slack:
            words.append(f"slack against {listed(self.slack)}")
        if not (self.regular or self.free or self.slack):
            words.append("not unique")
        if self.unstable > 0:
            words.append("not stable")
        named = sorted(self.prestress.items(), key=lambda item: item[1].ratio)
        if len(named) > MAX_NAMED_PARTS:
            # Of many parts the one that has lost most.
            named = named[:1]
        words += [f"prestress of '{name}' {reached.short()}" for name, reached in named]
        return ", ".join(words)

    def __repr__(self) -> str:
        return f"<EquilibriumResult: {self.summary()}>"


@dataclass(frozen=True)
class Assessment:
    """What nothing resists; whether the tangent without inertia is regular; and the number of its
    negative eigenvalues."""

    free: FreeMotions
    regular: bool
    unstable: int


def assess(search: Search, at: float) -> Assessment:
    """Look at the equilibrium under the loads of time `at` [s]: Newton's iteration without inertia
    starts once more from it.  Collective."""
    converges = search.solve_without_inertia(at)
    system = search.system
    search.unbalanced()
    K = system.matrices.tangent()
    stiffnesses = []
    for scalars in system.equations.scalar_unknowns:
        stiffnesses += scalars.static_stiffness()
    part, count = parts(system, K)
    free = free_motions(system, K, (part, count), search.unbalanced_forces, stiffnesses)
    if free.rigid or free.slack:
        # One part that moves freely does not hide that another one is not stable.
        return Assessment(free, False, count_beyond_round_off(system, K, part, count))
    if not converges:
        return Assessment(free, False, UNKNOWN)
    # With scalar unknowns K is only a block of the matrix, and may be singular in a regular one.
    if system.equations.scalar_unknowns:
        return Assessment(free, True, count_unstable(system, K))
    with symmetric_on_constraints(system, K) as symmetric:
        if symmetric is None:
            return Assessment(free, not factorisation.is_singular(K), UNKNOWN)
        factors = factorisation.SymmetricFactors(factorisation.equilibrated(symmetric))
    is_regular = not factors.is_singular()
    unstable = factors.negative - active_multipliers(system) if is_regular else UNKNOWN
    factors.destroy()
    return Assessment(free, is_regular, unstable)


def warn_of_lost_loads(search: Search) -> None:
    """Warn if the round-off of the inner forces hides the loads.  The residual is then small
    wherever the scene is, so that what is found is too stiff by any factor: a plate bends with
    the cube of its thickness, and round-off is that of its membrane forces."""
    load = float(search.system.equations.load_forces().norm())
    round_off = search.newton.round_off
    if 0 < load < LOST_LOAD * round_off and search.comm.rank == 0:
        # Imported here, as scenes without plates must not pay for it.
        from gossamer_fx.mechanics.bodies.plate import Plate

        remedy = "look at the units of the loads."
        if any(isinstance(body, Plate) for body in search.system.unknowns.bodies):
            remedy = "a plate this thin needs cells of aspect near one, or is a Membrane."
        LOG.warning(
            "The equilibrium does not show the loads: "
            "their %.1e N are far below the round-off of the inner forces, "
            "%.1e N, so that displacements may be too small by any factor; %s",
            load,
            round_off,
            remedy,
        )


def warn_of_quality(result: EquilibriumResult, search: Search, known: set[str]) -> None:
    """Warn of an equilibrium that has lost prestress, is above the tolerance, not unique, not
    regular or not stable.

    Args:
        known: motions that were warned of before in this search, e.g. at smaller loads; those of
            this result are added.
    """
    free = listed(result.free)
    slack = listed(result.slack)
    is_new_free = free not in known
    is_new_slack = slack not in known
    known.update((free, slack))
    if search.comm.rank > 0:
        return
    lost = lost_prestress_words(dict(result.prestress))
    if lost:
        LOG.warning("%s", lost)
    if not result.within_tolerance:
        LOG.warning(
            "The equilibrium has a residual of %.3g, above the tolerance %.3g, as the inner forces "
            "have a round-off of %.1e N; take it as it is, or give a larger tolerance of "
            "gx.analysis.Continuation.",
            result.residual,
            search.options.tolerance,
            search.newton.round_off,
        )
    if result.free and is_new_free:
        LOG.warning(
            "The equilibrium is not unique: nothing resists %s; "
            "hold it by gx.Fixed if it must not move.",
            free,
        )
    if result.slack and is_new_slack:
        LOG.warning(
            "The equilibrium is not unique: what is held is slack, without stiffness against %s; "
            "give it a prestress (initial_stress, tension) or a load across, if its shape matters.",
            slack,
        )
    if not (result.regular or result.free or result.slack):
        LOG.warning(
            "The equilibrium is not regular: "
            "its tangent is singular or Newton's iteration without inertia does not converge, "
            "as in slack film or at a limit load; "
            "shape and modes of such parts are not unique."
        )
    if result.unstable > 0:
        LOG.warning(
            "The equilibrium is not stable: its stiffness has %d negative eigenvalue%s, "
            "as in a balloon beyond its largest pressure or in film under compression; "
            "disturb the first guess to find another one, load in smaller steps, or follow it by "
            "gx.analysis.path.",
            result.unstable,
            "s" if result.unstable > 1 else "",
        )

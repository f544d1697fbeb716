"""Tensions, strains and lengths of the lines of springs, ropes, tethers and tapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.point_measures import evaluated_here
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.frames import DrawnAsLines
from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint
from gossamer_fx.mechanics.terms.point_energies import PointEnergies, PointStoredEnergy
from gossamer_fx.records.fields.body_shape import At, rule_at
from gossamer_fx.solve.system.system import System


@dataclass(frozen=True)
class LineForces:
    """Tensions and lengths of the n lines of a connector, the same on every rank.

    A spring, rope or tether is one line, a bundle has one for each rope, a tape one for each bar.

    Attributes:
        tensions: (n,) [N], negative for compression; without the force of a damping.  They are
            those of the last step, or at its end.
        lengths: distances (n,) [m] of the two ends.
        natural_lengths: (n,) [m]; of a tether with a brake those in this state.
        weights: shares (n,) of the lines in the mean of the connector, whose sum is one.
        alternating: share of the lines that are taut at one end of the last step only; zero of
            those that bear compression, and of the ropes on reels.
    """

    tensions: Array
    lengths: Array
    natural_lengths: Array
    weights: Array
    alternating: float = 0.0

    @property
    def strains(self) -> Array:
        """Changes of length over the natural lengths (n,); infinite where these are zero."""
        with np.errstate(divide="ignore"):
            found: Array = self.lengths / self.natural_lengths - 1
        return found


def line_forces(system: System, connector: DrawnAsLines, at: At) -> LineForces:
    """Tensions of a connector in the last step, and lengths at its end.  Collective."""
    terms = system.terms_of(connector)
    check(
        bool(terms),
        f"'{connector.name}' is not in the scene; ask for a part that is in it.",
    )
    stored = [term for term in terms if isinstance(term, PointStoredEnergy)]
    if stored:
        parts = [_of_stored_energy(system, term, connector, at) for term in stored]
        return _joined(parts)
    return _of_reel(system, connector, at)


def _of_stored_energy(
    system: System, term: PointStoredEnergy, connector: DrawnAsLines, at: At
) -> LineForces:
    """Tensions of the lines of one stored energy.

    The measure is e = ½ α l² + c of the length l.  With the stress S = dψ/de the tension is
    dψ/dl = S α l = 2 S (e - c)/l.  A spring has α = 1 and c = 0.  A tape has a multiple of
    ½(l²/L² - 1), so that l²/L² = (c - e)/c.  The mean force of a step acts in its middle, whose
    length is that of the tension.
    """
    [compiled] = system.compiled_as(PointEnergies)
    count = len(term.measure.ports)
    is_tape = bool(np.any(term.measure.c))
    if is_tape:
        tape: Any = connector
        natural = np.asarray(tape.lengths, dtype=np.float64)
    else:
        natural = np.broadcast_to(compiled.get_number(term, "L"), count).astype(np.float64)
    # Each line is evaluated on one rank: the sum over all ranks is its tension.
    here = evaluated_here(term.measure.ports)
    own_values = np.zeros((3, count))
    offset = np.broadcast_to(term.measure.c, (count, 1))[here, 0]

    def length(quadratic_part: Array) -> Array:
        """Lengths (r,) [m] of which ½ α l² (r,) is given."""
        if is_tape:
            return natural[here] * np.sqrt(np.maximum(-quadratic_part / offset, 0.0))
        return np.sqrt(2 * np.maximum(quadratic_part, 0.0))

    measure, stress = compiled.stresses(term, rule_at(at, system))
    quadratic_part = measure[:, 0] - offset
    acting_length = length(quadratic_part)
    # Coincident ends have no direction, and no tension along it.
    own_values[0, here] = np.divide(
        2 * stress[:, 0] * quadratic_part,
        acting_length,
        out=np.zeros(len(here)),
        where=acting_length > 0,
    )
    at_end, stress_at_end = compiled.stresses(term, EndPoint())
    own_values[1, here] = length(at_end[:, 0] - offset)
    if not system.rule.acts_at_end:
        _, stress_at_start = compiled.stresses(term, EndPoint(), at_start=True)
        # Springs are never without any stress.
        own_values[2, here] = (stress_at_end[:, 0] == 0) != (stress_at_start[:, 0] == 0)
    tensions, lengths, alternates = system.comm.allreduce(own_values)
    weights = np.full(count, 1 / count)
    if is_tape:
        # Bars are parts of one line, and count by their lengths; ropes are lines by themselves.
        weights = natural / natural.sum()
    return LineForces(tensions, lengths, natural, weights, float(weights @ alternates))


def _of_reel(system: System, connector: DrawnAsLines, at: At) -> LineForces:
    """Tension of a tether, whose natural length is on its reel."""
    # Imported here: a scene without a reel does not load it.
    from gossamer_fx.mechanics.connectors.tether import PaidOutRopes

    for ropes in system.compiled_as(PaidOutRopes):
        for number, term in enumerate(ropes.terms):
            # The names of parts are unique in a scene.
            if term.name == connector.name:
                ends = system.state.vectors(connector.lines_to_draw[0])
                length = float(np.linalg.norm(ends[1] - ends[0]))
                one = slice(number, number + 1)
                return LineForces(
                    tensions=ropes.tensions(mean=at == "mean")[one],
                    lengths=np.array([length]),
                    natural_lengths=ropes.lengths()[one],
                    weights=np.ones(1),
                )
    raise AssertionError(f"'{connector.name}' has neither a stored energy nor a reel")


def _joined(parts: list[LineForces]) -> LineForces:
    """The lines of several parts, which count alike in the mean."""
    weights = np.concatenate([part.weights for part in parts])
    return LineForces(
        tensions=np.concatenate([part.tensions for part in parts]),
        lengths=np.concatenate([part.lengths for part in parts]),
        natural_lengths=np.concatenate([part.natural_lengths for part in parts]),
        weights=weights / weights.sum(),
        alternating=float(np.mean([part.alternating for part in parts])),
    )

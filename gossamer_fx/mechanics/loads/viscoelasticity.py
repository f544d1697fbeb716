"""Viscoelastic films, cables and beams: Maxwell branches in parallel to an elastic law.

Problem.  The stress of a polymer film relaxes under a held strain.  A Prony series of its stiffness
is measured,

    C(t) = C (1 + Σ r_k exp(-t/τ_k)),                                                            (1)

and a step of any length has to conserve energy but for the loss.

Idea.  Each branch has an elastic strain z_k, whose rate is that of the strain e less z_k/τ_k, and
the energy r_k ψ(z_k), where ψ is the energy of the law with the stiffness C.  A step of length h
takes the exact solution of a branch for a strain that changes by Δe at a constant rate.  With x =
h/τ, E = exp(-x), φ = (1 - E)/x and g = (1 - φ)/x

    z1 = E z0 + φ Δe                                                                             (2)
    S_mean = r ψ'(φ z0 + g Δe)                                                                   (3)
    S_mean·Δe = r (ψ(z1) - ψ(z0)) + loss,
    loss = r ((1 - E²) ψ(z0) + x φ² ψ'(z0)·Δe + (2 g - φ²) ψ(Δe))                                (4)

(3) is the mean over the step of the stress r ψ'(z), and the loss that of 2 r ψ(z)/τ.  So (4) holds
exactly and the loss is never negative, as ψ is quadratic.  A branch is exact under a held strain
and under a steady rate, for any h, and of second order in h else.  One that relaxes within a step
is a viscosity r τ; z then is the strain of the last τ.  Stresses are linear in the strain, so that
momenta are conserved as those of damping are.

Films that wrinkle.  Their strain e is that of the wrinkled surface; the material under it has the
strain ε of which the stress ψ'(e) is that of taut film, ε = C⁻¹ ψ'(e).  With the stiffness C_n =
ψ''(e) at the start of a step

    Δε = C⁻¹ C_n Δe                                                                              (5)
    S_mean = r C_n (φ z0 + g Δε)                                                                 (6)

in place of Δe in (2) and (4), and of (3).  As S_mean·Δe = r C (φ z0 + g Δε)·Δε, (4) holds as
before.  So branches act in full where film is taut, along the folds where it is wrinkled, and not
where it is slack; there their strain relaxes.  C_n is that of the start, so that (6) is linear in
Δe and its derivative symmetric; where film changes its state within a step, ε misses a part of this
step.

Law and branches together have the stress ψ'(e) + Σ r_k C_n z_k, of a step that at the means of e
and z_k; fields and probes show it.

At rest the branches have relaxed: a search for equilibrium has the law alone.

Loss.  At the angular frequency ω the loss factor is

    η = Σ r_k ωτ_k/(1 + ω²τ_k²) / (1 + Σ r_k ω²τ_k²/(1 + ω²τ_k²)).                               (7)

Of branches that are evenly spaced in log τ it is nearly constant within their band.  A single
damping time β of `Damping` has η = βω.

Source of (1), "generalised Maxwell" or Wiechert model: J. D. Ferry, Viscoelastic properties of
polymers, Wiley 1980.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, ClassVar

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.arguments import Band, Range, at_least, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.forms.cell_loops import tabulation
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import energy_gradient
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Term
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.cable import Cable
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.loads.branches import BranchEnergies, BranchForces, check_branches
from gossamer_fx.mechanics.loads.damping import matrix_of, stiffness_entries
from gossamer_fx.mechanics.materials.film import FilmLaw
from gossamer_fx.mechanics.terms.assembly import Assembly, Compiler
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.element_energies import (
    ViscousDissipation,
)


@check_arguments(as_many("ratios", "times"))
@dataclass(frozen=True, eq=False)
class Viscoelasticity(OnBody):
    """Stiffness of a film, cable or beam that relaxes: C(t) = C (1 + Σ r_k exp(-t/τ_k)), with the
    stiffness C of its law.  The loss counts as dissipated, the energy of the branches as stored.

    `flat_damping` makes the branches of a loss factor that is constant in a band of frequencies.
    A standard linear solid has one branch.  Of a Prony series with shares g_k of the instantaneous
    modulus E0 give the law the modulus E0 (1 - Σ g_k), and r_k = g_k/(1 - Σ g_k).  The branches are
    relaxed at the start of a run, and in an `Equilibrium`.

    Args:
        body: a film, cable or beam.  Its law is quadratic in the strain, e.g. `Linear`, or that of
            a film which wrinkles, as `Miyazaki`, `TensionField` and `Orthotropic`.
        ratios: r_k, stiffness of each branch over that of the law.
        times: τ_k [s] of each branch.
        tension_only: whether the branches of a film that wrinkles act as its stiffness does at the
            start of each step: in full where it is taut, along the folds where it is wrinkled, not
            where it is slack.  Otherwise they act everywhere as in taut film, and resist wrinkles.
            Without meaning for other laws.
        name: name in messages and output.

    Raises:
        InputError: no branch, other numbers of ratios and times, one of them that is not positive;
            another law that is not quadratic, a plate, a body with thermal expansion.

    Example:
        >>> polymer = gx.Linear(1e9, 0.4, density=930.0, thickness=38e-6)
        >>> film = gx.Membrane(mesh, polymer)
        >>> gx.loads.Viscoelasticity(film, ratios=(0.5, 0.2), times=(1.0, 60.0)).name
        'viscoelasticity'
    """

    body: Membrane | Cable | Beam
    _: KW_ONLY
    ratios: Annotated[Sequence[Annotated[float, positive()]], at_least(1)]
    times: Sequence[Annotated[float, positive("s")]]
    tension_only: bool = True
    name: str = "viscoelasticity"

    def __post_init__(self) -> None:
        what = f"Viscoelasticity '{self.name}'"
        body = self.body
        check_branches(what, body)
        check(
            isinstance(body, Beam) or body.law.quadratic or _taut_law(body) is not None,
            f"{what}: the law of '{body.name}' is neither quadratic in the strain nor one that is "
            "when the film is taut; use e.g. Linear, Miyazaki, or a CableLaw of Green strain.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        body = self.body
        density = body.density
        taut = None if isinstance(body, Beam) or body.law.quadratic else _taut_law(body)
        wrinkling = None
        if taut is not None:
            density = partial(taut.energy, c=body.constants)
            if self.tension_only:
                strain = partial(taut.taut_strain, c=body.constants)
                wrinkling = Wrinkling(body.density, strain)
        yield RelaxingEnergy(
            self.name,
            body,
            body.measure,
            density,
            body.dx,
            discrete_derivative=body.discrete_derivative,
            ratios=tuple(self.ratios),
            times=tuple(self.times),
            wrinkling=wrinkling,
        )


# Frequencies of branches in a decade, and points in a decade at which the loss factor is fitted.
BRANCHES_A_DECADE = 1.25
POINTS_A_DECADE = 20
# Largest relative error of the loss factor within a band: with these numbers it is 5 %.
MAX_RIPPLE = 0.1


@check_arguments
def flat_damping(
    body: Membrane | Cable | Beam,
    *,
    loss_factor: Annotated[float, Range(0.0, 0.3, above=True)],
    band: Band,
    tension_only: bool = True,
    name: str = "damping",
) -> Viscoelasticity:
    """Damping whose loss factor is the same, to 5 %, at all frequencies of a band: a few branches.

    Films of polymers have nearly constant loss factors over many decades; that of `Damping` grows
    with the frequency.  As every material whose loss is flat, the body stiffens with the frequency,
    by the share 1.5 η for each decade of the band; its law is the stiffness below the band.

    Args:
        body: see `Viscoelasticity`.
        loss_factor: η, energy that a vibration loses in a cycle over 2π times its largest strain
            energy.  Of films see `gossamer_fx.presets.films`.
        band: the lowest and the highest frequency [Hz], e.g. that of the slowest motion that is to
            be damped, and that of the fastest that steps resolve or beyond.
        tension_only: see `Viscoelasticity`.
        name: name in messages and output.

    Raises:
        InputError: a loss factor that is not between 0 and 0.3, a band that does not rise, or what
            `Viscoelasticity` refuses.

    Example:
        >>> damping = gx.loads.flat_damping(film, loss_factor=0.01, band=(1.0, 1e4))
        >>> len(damping.ratios), round(sum(damping.ratios), 2)
        (6, 0.08)
    """
    # Imported here: branches that are given do not need it.
    from scipy.optimize import nnls

    low, high = band
    decades = math.log10(high / low)
    count = max(math.ceil(BRANCHES_A_DECADE * decades), 1) + 1
    candidates = 1 / (2 * math.pi * np.geomspace(low, high, count))
    points = np.geomspace(low, high, math.ceil(POINTS_A_DECADE * decades) + 2)
    # (7) is linear in the ratios when it is multiplied by its denominator.
    x = 2 * math.pi * points[:, None] * candidates
    fitted, _ = nnls((x - loss_factor * x**2) / (1 + x**2) / loss_factor, np.ones(len(points)))
    used = fitted > 0
    ratios = tuple(float(ratio) for ratio in fitted[used])
    times = tuple(float(time) for time in candidates[used])
    found = [loss_of(ratios, times, float(f)) for f in points]
    ripple = float(np.abs(np.array(found) / loss_factor - 1).max())
    check(
        ripple <= MAX_RIPPLE,
        f"flat_damping '{name}': in the band {tuple(band)!r} Hz branches miss the loss factor "
        f"{loss_factor:g} by {100 * ripple:.0f} %; give a smaller one, or a wider band.",
    )
    return Viscoelasticity(body, ratios=ratios, times=times, tension_only=tension_only, name=name)


def loss_of(ratios: Sequence[float], times: Sequence[float], frequency: float) -> float:
    """Loss factor of branches at a frequency [Hz], equation (7): r_k and τ_k [s]."""
    storage = 1.0
    loss = 0.0
    for ratio, time in zip(ratios, times, strict=True):
        x = 2 * math.pi * frequency * time
        storage += ratio * x**2 / (1 + x**2)
        loss += ratio * x / (1 + x**2)
    return loss / storage


def _taut_law(body: Membrane | Cable) -> FilmLaw | None:
    """The law of a film when it is taut, if that is linear and can be inverted."""
    if not isinstance(body, Membrane) or type(body.law).unwrinkled is FilmLaw.unwrinkled:
        return None
    law = body.law.unwrinkled()
    has_inverse = type(law).taut_strain is not FilmLaw.taut_strain
    return law if law.quadratic and has_inverse else None


class RelaxingEnergies(BranchEnergies):
    """All `RelaxingEnergy` terms of a scene; at rest they have no stress."""

    relaxes = True

    def __init__(self, terms: Sequence[RelaxingEnergy], system: Assembly) -> None:
        super().__init__([] if system.rule.is_static else terms, system)

    def _branch_forces(
        self, term: ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> RelaxingForces:
        assert isinstance(term, RelaxingEnergy)
        return RelaxingForces(term, at, rule)


@dataclass(frozen=True, eq=False)
class Wrinkling:
    """What branches know of the law of a film that wrinkles.

    Attributes:
        density: its energy density [J/m²] of a strain (3,), whose second derivative is C_n.
        strain: C⁻¹ S, the strain (3,) at which taut film has the stress S (S11, S22, S12) [N/m].
    """

    density: Callable[[Expr], Expr]
    strain: Callable[[Expr], Expr]


@dataclass(frozen=True, eq=False)
class RelaxingEnergy(ViscousDissipation):
    """Energies Σ r_k ∫ψ(z_k) dx of Maxwell branches; `density` is ψ, quadratic and convex, as a
    function of the measure; `ratios` are r_k, `times` τ_k [s]; `wrinkling` is that of branches that
    act as a film does which wrinkles, equations (5) and (6), else None."""

    _: KW_ONLY
    ratios: tuple[float, ...]
    times: tuple[float, ...]
    wrinkling: Wrinkling | None = None
    compiler: ClassVar[Compiler] = RelaxingEnergies


# Terms of the series of `mean_weight`, and the x = h/τ below which it is used: (1 - φ)/x loses
# digits there, and with them the balance of energy.
SERIES_TERMS = 18
SERIES_LIMIT = 1.0


def mean_weight(x: float) -> float:
    """g = (1 - φ)/x with φ = (1 - exp(-x))/x, the share of a change of strain that is in the mean
    of a branch over a step, to round-off; it is 1/2 at x = 0."""
    if x > SERIES_LIMIT:
        return (1 - (1 - math.exp(-x)) / x) / x
    return math.fsum((-x) ** k / math.factorial(k + 2) for k in range(SERIES_TERMS))


@dataclass(frozen=True)
class StepWeights:
    """Numbers of (2) to (4) of one branch in a step: E, φ and g."""

    decay: float
    change: float
    mean: float

    @staticmethod
    def of(step: float, time: float) -> StepWeights:
        """Those of a step [s] and a relaxation time [s]."""
        x = step / time
        mean = mean_weight(x)
        change = 1 - x * mean
        # By φ, so that (4) holds to round-off.
        return StepWeights(decay=1 - x * change, change=change, mean=mean)


class RelaxingForces(BranchForces):
    """Stresses, loss and history of one `RelaxingEnergy`; numbers of equations are those of the
    module.  The history variables are the z_k of each branch."""

    term: RelaxingEnergy

    def __init__(self, term: RelaxingEnergy, at: Coordinates, rule: StressRule) -> None:
        """Make the history, all zero, and compile.  Collective."""
        mesh = at.q1.function_space.mesh
        (size,) = term.measure(at.q1).ufl_shape
        space = fem.functionspace(mesh, self._element(term, mesh, size))
        # Σ r_k φ_k z_k and Σ r_k g_k of the present step, of which the stress is made
        self._start = fem.Function(space)
        self._gain = constant(mesh, 0.0)
        # Of one branch after the other, for its energy and loss: z, r, and the factors of (4)
        self._z = fem.Function(space)
        self._ratio = constant(mesh, 0.0)
        self._loss_factors = [constant(mesh, 0.0) for _ in range(3)]
        # C_n of a film that wrinkles, row by row
        self._stiffness: fem.Function | None = None
        if term.wrinkling is not None:
            element = self._element(term, mesh, size * size)
            self._stiffness = fem.Function(fem.functionspace(mesh, element))
        self._weights = [StepWeights.of(0.0, time) for time in term.times]
        super().__init__(term, at, rule)
        self.history = [self._nothing(size) for _ in term.times]
        self._energy = compile_form(self._ratio * term.density(self._z) * term.dx)
        strain = term.measure(at.q1)
        # Strain e at the start of a step, and the change of the branches' strain in it
        self._strain_at_start = fem.Function(space)
        self._change = fem.Function(space)
        self._set_strain: Callable[[], None] = tabulation(strain, self._strain_at_start)
        change = self._material_change(strain - self._strain_at_start)
        self._set_change: Callable[[], None] = tabulation(change, self._change)
        self._set_stiffness: Callable[[], None] = lambda: None
        if term.wrinkling is not None and self._stiffness is not None:
            entries = stiffness_entries(term.wrinkling.density, strain)
            self._set_stiffness = tabulation(entries, self._stiffness)
        # The stress of Σ r_k z_k, for fields
        self._set_shown: Callable[[], None] = tabulation(self._stress_of(self._z), self._shown)

    def _material_change(self, change: Expr) -> Expr:
        """Δε of a change Δe of the strain: (5), or Δe itself."""
        wrinkling = self.term.wrinkling
        if wrinkling is None:
            return change
        return wrinkling.strain(ufl.dot(matrix_of(self._stiffness), change))

    def _stress_of(self, z: Expr) -> Expr:
        """The stress of a strain z of the branches: ψ'(z), or C_n z."""
        if self.term.wrinkling is None:
            return energy_gradient(self.term.density, z)
        return ufl.dot(matrix_of(self._stiffness), z)

    def _stress(self, change: Expr) -> Expr:
        # Equation (3) or (6).
        return self._stress_of(self._start + self._gain * self._material_change(change))

    def _loss(self, change: Expr) -> Expr:
        # Equation (4), of the branch that `dissipated` sets.
        ψ = self.term.density
        z = self._z
        change = self._material_change(change)
        of_start, of_both, of_change = self._loss_factors
        mixed = ufl.dot(energy_gradient(ψ, z), change)
        return of_start * ψ(z) + of_both * mixed + of_change * ψ(change)

    def dissipated(self) -> float:
        loss = 0.0
        parts = zip(self.term.ratios, self._weights, self.history, strict=True)
        for ratio, weights, z in parts:
            self._put(z, self._z)
            # 1 - E², x φ² = (1 - E) φ, and 2 g - φ²
            of_start = (1 - weights.decay) * (1 + weights.decay)
            of_both = (1 - weights.decay) * weights.change
            of_change = 2 * weights.mean - weights.change**2
            numbers = (of_start, of_both, of_change)
            for factor, number in zip(self._loss_factors, numbers, strict=True):
                factor.value = ratio * number
            loss += super().dissipated()
        return loss

    def begin_step(self, h: float) -> None:
        self._weights = [StepWeights.of(h, time) for time in self.term.times]
        self._gain.value = sum(
            ratio * weights.mean
            for ratio, weights in zip(self.term.ratios, self._weights, strict=True)
        )
        self._put(self._mean_of(0.0), self._start)

    def commit(self) -> None:
        """Take the strain of the accepted state, and at the end of a step z by equation (2)."""
        if self.in_step:
            self._set_change()
            change = self._values_of(self._change)
            self._show(self._mean_of(change))
            self.mean[:] = self._values_of(self._shown)
            for weights, z in zip(self._weights, self.history, strict=True):
                z *= weights.decay
                z += weights.change * change
        self._set_strain()
        self._set_stiffness()

    def _mean_of(self, change: Array | float) -> Array:
        """Σ r_k (φ_k z_k + g_k Δε) of the z_k at the start of a step, as one of `history`."""
        total = np.zeros_like(self.mean)
        for ratio, weights, z in zip(self.term.ratios, self._weights, self.history, strict=True):
            total += ratio * (weights.change * z + weights.mean * change)
        return total

    def _show(self, strains: Array) -> None:
        """Set the shown stress to that of strains of the branches, as one of `history`."""
        self._put(strains, self._z)
        self._set_shown()

    def show_end(self) -> None:
        parts = zip(self.term.ratios, self.history, strict=True)
        self._show(np.asarray(sum(ratio * z for ratio, z in parts)))

    def energy(self) -> float:
        energy = 0.0
        for ratio, z in zip(self.term.ratios, self.history, strict=True):
            self._put(z, self._z)
            self._ratio.value = ratio
            energy += float(fem.assemble_scalar(self._energy))
        return energy

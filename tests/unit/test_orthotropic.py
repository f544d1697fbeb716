"""The orthotropic film that bears no compression: its C functions and its UFL against theory, at
given strains."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from scipy.optimize import minimize

import gossamer_fx as gx
from gossamer_fx.analysis.reduction.points import own_cells
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.c_source import c_library
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.forms.kinematics import cell_axes
from gossamer_fx.core.forms.strain_path import energy_gradient, with_derivative
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED, constants
from gossamer_fx.mechanics.materials.orthotropic import HEADER
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.meshes.sheet import sheet
from tests.sentences import assert_sentence
from tests.strain_samples import CENTRE, SQUARE, Samples, random_strains

FABRIC = {"density": 1.0, "thickness": 1.0, "direction": (1.0, 0.0, 0.0)}
NEARLY_ISOTROPIC = gx.Orthotropic(1.0, 1.0, 0.3, 1 / 2.6, **FABRIC)
LAWS = {
    "isotropic": NEARLY_ISOTROPIC,
    "10:1": gx.Orthotropic(10.0, 1.0, 0.3, 0.5, **FABRIC),
    "100:1": gx.Orthotropic(100.0, 1.0, 0.3, 0.05, **FABRIC),
    "fabric": gx.Orthotropic(1.0, 1.0, 0.3, 0.01, **FABRIC),
    # two maxima of e_tt²/F_tt
    "stiff in shear": gx.Orthotropic(1.0, 1.0, 0.3, 20.0, **FABRIC),
    # stiffnesses of braids for inflatable decelerators [kN/m]; condition 124 to 323
    "braid": gx.Orthotropic.from_stiffnesses(335.8, 704.1, 1525.8, 702.9, **FABRIC),
    "steep braid": gx.Orthotropic.from_stiffnesses(75.6, 502.0, 4014.0, 504.1, **FABRIC),
    "residual": gx.Orthotropic(10.0, 1.0, 0.3, 0.5, residual_stiffness=0.2, **FABRIC),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())


def along(direction) -> gx.Orthotropic:
    """A law whose first axis has this direction."""
    return gx.Orthotropic(1.0, 1.0, 0.3, 0.5, **FABRIC | {"direction": direction})


def stiffness(law: gx.Orthotropic) -> np.ndarray:
    """C (3, 3) [N/m] in the axes."""
    F = np.array(
        [
            [1 / law.E1, -law.nu12 / law.E1, 0],
            [-law.nu12 / law.E1, 1 / law.E2, 0],
            [0, 0, 1 / law.G12],
        ]
    )
    return np.linalg.inv(F) * law.thickness


def compiled(quantity: str, law: gx.Orthotropic, e0, e1, angle: float = 0.0) -> np.ndarray:
    """A C function at strains (n, 3), with the first axis at an angle."""
    c = c_library(HEADER)
    signature = "void (*)(double *, double *, double *, double *, int *, uint8_t *, void *)"
    address = c.lib.orthotropic_function(getattr(c.lib, quantity))
    function = c.ffi.cast(signature, address)
    n = len(e0)
    C = stiffness(law)
    numbers = [np.cos(angle), np.sin(angle), C[0, 0], C[0, 1], C[1, 1], C[2, 2]]
    numbers.append(law.residual_stiffness)
    laws = np.tile(numbers, (n, 1))
    arguments = np.concatenate([np.ravel(e0), np.ravel(e1), np.ravel(laws)])
    values = np.zeros((n, 1 if quantity == "DENSITY" else 12))
    count = np.array([float(n)])
    pointers = [c.ffi.from_buffer("double[]", a) for a in (values, arguments, count)]
    function(*pointers, c.ffi.NULL, c.ffi.NULL, c.ffi.NULL, c.ffi.NULL)
    return values


def energy(law, e, angle: float = 0.0) -> np.ndarray:
    return compiled("DENSITY", law, e, e, angle)[:, 0]


def response(law, e, angle: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Stress (n, 3) and its derivative (n, 3, 3)."""
    values = compiled("END_POINT", law, e, e, angle)
    return values[:, :3], values[:, 3:].reshape(-1, 3, 3)


def average(law, e0, e1) -> tuple[np.ndarray, np.ndarray]:
    """Stress (n, 3) averaged along paths, and its derivative (n, 3, 3) by the end."""
    values = compiled("PATH_AVERAGE", law, e0, e1)
    return values[:, :3], values[:, 3:].reshape(-1, 3, 3)


def in_ufl(law, quantity: str) -> Samples:
    """Energy, state, or stress and derivative of a law's UFL."""
    c = constants(law, SQUARE)
    c.cosine = 1.0
    c.sine = 0.0

    def expression(e):
        e = ufl.variable(e)
        if quantity == "energy":
            return law.energy(e, c)
        if quantity == "state":
            return law.state(e, c) * 1.0
        return with_derivative(ufl.diff(law.energy(e, c), e), e)

    return Samples(expression)


def test_equal_stiffness_in_all_directions_is_the_tension_field() -> None:
    """Energy, stress and its derivative of `TensionField` in closed form."""
    e = random_strains(2000, 0.1, seed=1)
    isotropic = gx.TensionField(1.0, 0.3, density=1.0, thickness=1.0)
    expected = in_ufl(isotropic, "response")(e)
    S, D = response(NEARLY_ISOTROPIC, e, angle=0.7)
    assert abs(energy(NEARLY_ISOTROPIC, e) - in_ufl(isotropic, "energy")(e)[:, 0]).max() <= 1e-14
    assert abs(S - expected[:, :3]).max() <= 1e-12 * abs(S).max()
    assert abs(D.reshape(-1, 9) - expected[:, 3:]).max() <= 1e-12 * abs(D).max()


@every_law
def test_turning_film_and_strain_turns_the_stress(law) -> None:
    e = random_strains(1000, 0.1, seed=2)
    angle = 0.6
    c = np.cos(angle)
    s = np.sin(angle)
    R = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    S, D = response(law, e @ R.T)
    turned_S, turned_D = response(law, e, angle)
    assert abs(turned_S - S @ R).max() <= 1e-12 * abs(S).max()
    # Where the wrinkles just vanish round-off decides between two states.
    error = abs(turned_D - R.T @ D @ R).max(axis=(1, 2))
    assert np.quantile(error, 0.99) <= 1e-12 * abs(D).max()


@every_law
@pytest.mark.parametrize(
    "pairs", [10_000, pytest.param(1_000_000, marks=pytest.mark.slow)], ids=str
)
def test_the_energy_is_convex(law, pairs: int) -> None:
    """(S(a) - S(b))·(a - b) ≥ 0, and the chord lies above the curve."""
    a = random_strains(pairs, 0.1, seed=3)
    b = random_strains(pairs, 0.1, seed=4)
    monotone = np.einsum("ni,ni->n", response(law, a)[0] - response(law, b)[0], a - b)
    largest = energy(law, a).max()
    assert monotone.min() >= -1e-14 * largest
    chord = (energy(law, a) + energy(law, b)) / 2 - energy(law, (a + b) / 2)
    assert chord.min() >= -1e-14 * largest


@every_law
def test_the_energy_is_the_least_over_all_wrinkles(law) -> None:
    """min over A = Σ v⊗v of ½ (e + A):C:(e + A), by a general minimiser."""
    C = stiffness(law)
    strains = random_strains(12, 1.0, seed=5)
    u = law.residual_stiffness
    for e, W in zip(strains, energy(law, strains), strict=True):

        def elastic(x: np.ndarray, e=e) -> float:
            v = x[:2]
            w = x[2:]
            wrinkles = [
                v[0] ** 2 + w[0] ** 2,
                v[1] ** 2 + w[1] ** 2,
                2 * (v[0] * v[1] + w[0] * w[1]),
            ]
            q = e + np.array(wrinkles)
            return q @ C @ q / 2

        rng = np.random.default_rng(6)
        least = min(minimize(elastic, rng.normal(size=4), tol=1e-14).fun for _ in range(6))
        assert (1 - u) * least + u * (e @ C @ e) / 2 == pytest.approx(W, rel=1e-7, abs=1e-9)


@every_law
def test_stress_and_stiffness_are_derivatives_of_the_energy(law) -> None:
    e = random_strains(2000, 1.0, seed=7)
    S, D = response(law, e)
    δ = 1e-6
    ends = [(e + δ * d, e - δ * d) for d in np.eye(3)]
    slopes = [(energy(law, up) - energy(law, down)) / (2 * δ) for up, down in ends]
    assert abs(np.stack(slopes, axis=1) - S).max() <= 1e-8 * abs(S).max()
    changes = [(response(law, up)[0] - response(law, down)[0]) / (2 * δ) for up, down in ends]
    # At the boundary of two states a difference over both of them is not a derivative.
    error = abs(np.stack(changes, axis=2) - D).max(axis=(1, 2))
    assert np.quantile(error, 0.99) <= 1e-7 * abs(D).max()


@every_law
def test_stiffness_is_symmetric_and_positive(law) -> None:
    _, D = response(law, random_strains(5000, 1.0, seed=8))
    assert abs(D - D.swapaxes(1, 2)).max() <= 1e-13 * abs(D).max()
    assert np.linalg.eigvalsh(D).min() >= -1e-12 * abs(D).max()


@every_law
@pytest.mark.parametrize("size", [1e-4, 0.3, 3.0])
def test_the_average_does_the_work_of_the_energy(law, size: float) -> None:
    """S_mean·Δe = ΔW on paths through all states, and S_mean is the mean of many short ones."""
    e0 = random_strains(1000, 1.0, seed=9)
    e1 = e0 + random_strains(1000, size, seed=10)
    S, _ = average(law, e0, e1)
    work = np.einsum("ni,ni->n", S, e1 - e0)
    assert abs(work - energy(law, e1) + energy(law, e0)).max() <= 1e-14 * energy(law, e1).max()
    cuts = np.linspace(0, 1, 41)
    mean = np.zeros_like(S)
    for a, b in pairwise(cuts):
        mean += average(law, e0 + a * (e1 - e0), e0 + b * (e1 - e0))[0] / 40
    assert abs(S - mean).max() <= 1e-6 * abs(S).max()


@every_law
def test_the_derivative_of_the_average(law) -> None:
    e0 = random_strains(2000, 1.0, seed=11)
    e1 = e0 + random_strains(2000, 0.3, seed=12)
    _, D = average(law, e0, e1)
    δ = 1e-6
    changes = [
        (average(law, e0, e1 + δ * d)[0] - average(law, e0, e1 - δ * d)[0]) / (2 * δ)
        for d in np.eye(3)
    ]
    error = abs(np.stack(changes, axis=2) - D).max(axis=(1, 2))
    assert np.quantile(error, 0.95) <= 1e-7 * abs(D).max()
    # The average of a convex energy is the gradient of a convex one.
    assert abs(D - D.swapaxes(1, 2)).max() <= 1e-3 * abs(D).max()
    assert np.linalg.eigvalsh((D + D.swapaxes(1, 2)) / 2).min() >= -1e-6 * abs(D).max()


@every_law
def test_ufl_says_the_same_as_the_kernel(law) -> None:
    e = random_strains(1000, 0.1, seed=13)
    S, D = response(law, e)
    deviation = abs(in_ufl(law, "energy")(e)[:, 0] - energy(law, e)).max()
    assert deviation <= 1e-13 * energy(law, e).max()
    found = in_ufl(law, "response")(e)
    assert abs(found[:, :3] - S).max() <= 1e-11 * abs(S).max()
    assert abs(found[:, 3:] - D.reshape(-1, 9)).max() <= 1e-9 * abs(D).max()


@every_law
def test_states_are_those_of_the_stress(law) -> None:
    """Two positive principal stresses, one, or none; u = 0.2 pushes in the other directions."""
    e = random_strains(1000, 0.1, seed=14)
    state = in_ufl(law, "state")(e)[:, 0]
    S, _ = response(law, e)
    C = stiffness(law)
    u = law.residual_stiffness
    relaxed = (S - u * e @ C) / (1 - u)
    determinant = relaxed[:, 0] * relaxed[:, 1] - relaxed[:, 2] ** 2
    size = abs(relaxed).max()
    assert set(state) == {SLACK, WRINKLED, TAUT}
    assert abs(relaxed[state == SLACK]).max() <= 1e-14 * size
    assert abs(determinant[state == WRINKLED]).max() <= 1e-13 * size**2
    assert determinant[state == TAUT].min() > 0


@every_law
def test_paths_between_strains_of_special_shape_are_finite_and_do_the_work(law) -> None:
    """Zero, equal and opposite strains, uniaxial ones, limits between states, round-off, and very
    different sizes."""
    special = np.array(
        [
            [0.0, 0.0, 0.0],
            [1e-17, -1e-17, 1e-17],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 0.0],
            [1.0, -1.0, 0.0],
            [1.0, 1.0, 2.0],
            [1.0, -law.nu12, 0.0],
            [-law.nu21, 1.0, 0.0],
            [1e-6, 1e-9, -1e-7],
            [1.0, 1e-12, 1e-12],
        ]
    )
    strains = np.vstack([special, -special, 1e-8 * special])
    e0 = np.repeat(strains, len(strains), axis=0)
    e1 = np.tile(strains, (len(strains), 1))
    S, D = average(law, e0, e1)
    assert np.isfinite(S).all()
    assert np.isfinite(D).all()
    assert np.isfinite(response(law, strains)[1]).all()
    work = np.einsum("ni,ni->n", S, e1 - e0)
    energies = energy(law, e0), energy(law, e1)
    assert abs(work - energies[1] + energies[0]).max() <= 1e-12 * energies[0].max()


def test_film_without_strain_is_taut_and_free_of_stress() -> None:
    """Round-off does not decide: its stiffness is that of the taut film."""
    law = LAWS["10:1"]
    round_off = 1e-16 * np.random.default_rng(15).standard_normal((100, 3))
    S, D = response(law, round_off)
    assert abs(S).max() < 1e-14
    assert abs(D - stiffness(law)).max() <= 1e-14 * abs(D).max()
    _, D = average(law, np.zeros((1, 3)), np.zeros((1, 3)))
    assert abs(D - stiffness(law) / 2).max() <= 1e-14 * abs(D).max()


def first_axis(film: gx.Membrane) -> np.ndarray:
    """The first axis (cells, 3) of the law of a film, from its components in the film's frame."""
    c = film.constants
    axis = ufl.dot(cell_axes(film.space.mesh), ufl.as_vector([c.cosine, c.sine]))
    expression = compile_expression(axis, CENTRE)
    return evaluate(expression, film.space.mesh, own_cells(film))


SLANTED = (1.0, 2.0, 5.0)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "direction",
    [SLANTED, {"film": SLANTED}, lambda X: np.repeat(np.array([SLANTED]).T, X.shape[1], axis=1)],
    ids=["vector", "groups", "function"],
)
def test_direction_is_projected_on_the_film(comm, direction) -> None:
    film = gx.Membrane(sheet(comm, 3, 3), along(direction))
    assert abs(first_axis(film) - np.array([1.0, 2.0, 0.0]) / 5**0.5).max(initial=0.0) < 1e-14


def test_hoops_of_a_tube_go_around_its_axis() -> None:
    hoops = gx.materials.AroundAxis((0, 0, 2.0), point=(1.0, 0, 0))
    directions = hoops(np.array([[1.0, 2.0], [3.0, 0.0], [7.0, 5.0]]))
    assert directions.T.tolist() == [[-6.0, 0.0, 0.0], [0.0, 2.0, 0.0]]


@pytest.mark.parametrize(
    ("act", "culprit"),
    [
        (lambda: gx.Orthotropic(1.0, 4.0, 0.6, 0.5, **FABRIC), "nu12 is 0.6"),
        (
            lambda: gx.Orthotropic.from_stiffnesses(1.0, 2.0, 3.0, 1.0, **FABRIC),
            "not positive definite",
        ),
        (
            lambda: gx.Orthotropic(1.0, 1.0, 0.3, 0.5, residual_stiffness=2.0, **FABRIC),
            "residual_stiffness is 2.0",
        ),
        (lambda: along({"a": (0.0, 0.0, 0.0)}), "direction is {'a': (0.0, 0.0, 0.0)}"),
        (lambda: gx.materials.AroundAxis((0.0, 0.0, 0.0)), "axis"),
    ],
)
def test_bad_numbers_get_one_sentence(act, culprit: str) -> None:
    with pytest.raises(gx.InputError) as caught:
        act()
    assert_sentence(caught.value, culprit)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("direction", "culprit"),
    [
        ((0.0, 0.0, 1.0), "normal to the film"),
        ({"left part": (1.0, 0.0, 0.0)}, "left part"),
        (lambda X: 0.0 * X, "zero or not given"),
        (lambda X: X[:2], "direction"),
    ],
)
def test_bad_directions_get_one_sentence(comm, direction, culprit: str) -> None:
    with pytest.raises(gx.InputError, match=culprit) as caught:
        gx.Membrane(sheet(comm, 2, 2), along(direction))
    assert "\n" not in str(caught.value)


def test_a_rule_without_a_function_for_laws_in_c_is_refused_by_name():
    """A user's stress rule, which is a formula in UFL, with a law whose stress is written in C."""

    class AtTheEnd(StressRule):
        alpha = 0.5

        def stress(self, energy, e0, e1):
            return energy_gradient(energy.density, e1)

    film = gx.Membrane(sheet(MPI.COMM_SELF, 1, 1), NEARLY_ISOTROPIC, name="tent")
    with pytest.raises(gx.InputError, match="'tent': the stress rule AtTheEnd cannot be used"):
        gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3, rule=AtTheEnd()))


@every_law
def test_the_strain_of_a_taut_stress_is_the_inverse_of_the_stress(law) -> None:
    """Along the axes of the film; the shear of a strain is twice E12."""
    c = constants(law, SQUARE)
    c.cosine = 1.0
    c.sine = 0.0
    stress = np.array([[1.0, 2.0, 0.3], [0.4, 0.3, -0.15], [2.0, 1.0, 0.0]])
    e = Samples(lambda S: law.taut_strain(S, c))(stress)
    assert e @ stiffness(law) == pytest.approx(stress, rel=1e-12, abs=1e-12)


@every_law
@pytest.mark.parametrize("pulled", [0, 1])
def test_film_that_is_pulled_in_one_axis_only_is_taut(law, pulled: int) -> None:
    """Its stress across is zero to round-off, on the boundary of the states taut and wrinkled."""
    c = constants(law, SQUARE)
    c.cosine = 1.0
    c.sine = 0.0
    stress = np.zeros((20, 3))
    stress[:, pulled] = np.linspace(0.1, 2.0, 20)
    state = Samples(lambda e: law.state(e, c) * 1.0)(stress @ np.linalg.inv(stiffness(law)))
    assert set(state.ravel()) == {TAUT}

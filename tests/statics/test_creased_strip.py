"""A creased strip pulled at its ends: hinge and elastica, derived twice, against plates; and a
crease identified.

The table holds for panels of 0.05 m, k = 2e-3 N m/(m rad), rest angle 120°, E = 2.5 GPa, t = 50 µm,
ν = 0.  It follows from the first integral of the elastica, ½ B φ'² = F (cos φ1 - cos φ), φ1 at the
end of a panel, φ0 = θ/2 at the crease:

    l = ∫ dφ / φ',    B φ'(0) = k (θ - θr),    distance of the ends 2 ∫ cos φ ds
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import quad
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.common.crease_identification import GRAVITY, HangingStrip, identify_crease
from demos.studies import crease
from demos.studies.crease import LENGTH, REST, STIFFNESS, STRIP, WIDTH
from gossamer_fx.meshes.creased_strip import creased_strip
from tests.small_scenes import at_rest

# force [N/m], angle between the panels (180° - θ) [deg], distance of the ends [mm], depth of the V
# [mm]
TABLE = (
    (0.003, 63.468904, 58.922268, 40.362531),
    (0.01, 69.756794, 72.641667, 34.057634),
    (0.03, 79.877276, 87.194181, 23.128261),
    (0.05, 85.493227, 91.687953, 17.797630),
    (0.1, 93.809912, 95.390221, 11.801886),
    (0.3, 108.892362, 98.219782, 5.688885),
)


def by_quadrature(force: float) -> tuple[float, float, float]:
    """A row of the table.

    With p = sin(φ1/2) and sin(φ/2) = p cosh u the singular integrand at the end becomes ds =
    du/(√(F/B) cos(φ/2)).
    """
    B = STRIP.bending_stiffness

    def along(φ1: float, φ0: float, what: Callable[[float], float]) -> float:
        p = math.sin(φ1 / 2)
        half = lambda u: math.asin(min(1.0, p * math.cosh(u)))  # noqa: E731
        integrand = lambda u: what(2 * half(u)) / math.cos(half(u)) / math.sqrt(force / B)  # noqa: E731
        return float(
            # Integrals to 1e-12, since the table is compared with seven digits.
            quad(
                integrand,
                0,
                # The substitution ends where φ reaches its value at the hinge.
                math.acosh(math.sin(φ0 / 2) / p),
                epsabs=1e-14,
                epsrel=1e-12,
            )[0]
        )

    def end(φ0: float) -> float:
        return float(
            brentq(
                lambda φ1: along(φ1, φ0, lambda φ: 1.0) - LENGTH,
                1e-12,
                φ0 * (1 - 1e-14),
                xtol=1e-15,
            )
        )

    def imbalance(φ0: float) -> float:
        moment = math.sqrt(2 * force * B * (math.cos(end(φ0)) - math.cos(φ0)))
        # Moment of the strip less that of the crease.
        return moment - STIFFNESS * (REST - 2 * φ0)

    φ0 = float(brentq(imbalance, 1e-3, REST / 2 * (1 - 1e-9), xtol=1e-14))
    lengths = [1e3 * along(end(φ0), φ0, what) for what in (math.cos, math.sin)]
    return 180 - 2 * math.degrees(φ0), 2 * lengths[0], lengths[1]


@pytest.mark.parametrize("row", TABLE)
def test_the_table_by_quadrature_and_as_a_boundary_value_problem(row: tuple[float, ...]) -> None:
    force, *expected = row
    # The table has eight digits.
    assert by_quadrature(force) == pytest.approx(expected, rel=1e-7)
    angle, distance = STRIP.equilibrium(REST, STIFFNESS, force * WIDTH)
    computed = 180 - math.degrees(angle)
    assert computed == pytest.approx(expected[0], rel=1e-7)
    assert 1e3 * distance == pytest.approx(expected[1], rel=1e-7)


@pytest.mark.parametrize("force, tolerance", [(0.01, 0.05), (0.3, 0.7)])
def test_plates_of_eight_cells(comm, force: float, tolerance: float) -> None:
    found = crease.problem(comm, force, 8)
    # Eight cells along half of the strip.
    assert found["d/exact"] == pytest.approx(1.0, abs=1e-3)
    assert found["angle error [deg]"] < tolerance


def test_a_crease_alone_carries_the_moment_at_its_hinge(comm) -> None:
    """A held strip, loaded at its end: with a stiff crease it moves as without one, with a soft one
    F l²/(k b) more."""
    ends = []
    for stiffness in (None, 1e3, 1e-2):
        mesh = creased_strip(comm, 6, 1, LENGTH, WIDTH)
        plate = gx.Plate(mesh, crease.LAW, hinges=[] if stiffness is None else ["crease"])
        folds = (
            []
            if stiffness is None
            else [gx.connectors.Crease(plate, "crease", stiffness=stiffness)]
        )
        load = gx.loads.EdgeLoad(plate, "right", force=(0.0, 0.0, 1e-5))
        search = at_rest(plate, gx.Fixed(plate, "left", rotation=True), load, *folds)
        ends.append(
            comm.allreduce(float(search.system.unknowns.q0.array_r[2::3].max()), op=MPI.MAX)
        )
    # A crease of 1e3 N m/m/rad is as good as none.
    assert ends[1] == pytest.approx(ends[0], rel=1e-2)
    computed = ends[2] - ends[1]
    # The angle of the hinge is F l/(k b), and moves the end by it times l.
    assert computed == pytest.approx(1e-5 * LENGTH**2 / 1e-2, rel=1e-2)


def test_own_weight_opens_a_hanging_strip() -> None:
    """Half of the weight of a strip that is light compared with its load acts at its end."""
    heavy = HangingStrip(
        LENGTH,
        WIDTH,
        bending_stiffness=STRIP.bending_stiffness,
        area_density=0.07,
    )
    computed = heavy.equilibrium(REST, STIFFNESS, 1e-4)[0]
    assert computed < STRIP.equilibrium(REST, STIFFNESS, 1e-4)[0]


def measured(noise: float) -> tuple[list[float], list[float], list[float]]:
    """Weights [N], angles [rad] and distances [m] of a strip, with errors of `noise` standard
    deviations."""
    weights = [1e-5, 1e-4, 5e-4, 3e-3]
    random = np.random.default_rng(3)
    rows = [STRIP.equilibrium(1.9, 3e-3, weight) for weight in weights]
    # 0.5 degrees and 0.2 mm as standard deviations.
    angles = [a + noise * math.radians(0.5) * random.normal() for a, _ in rows]
    return weights, angles, [d + noise * 2e-4 * random.normal() for _, d in rows]


def test_identification_of_exact_data() -> None:
    weights, angles, distances = measured(0.0)
    found = identify_crease(STRIP, weights, angles=angles, distances=distances)
    # Data are exact; the search ends at its tolerance.
    assert found.rest_angle == pytest.approx(1.9, rel=1e-5)
    assert found.stiffness == pytest.approx(3e-3, rel=1e-4)
    assert found.misfit < 1e-3


def test_identification_of_data_with_errors_and_its_uncertainty() -> None:
    uncertainties = {"angle_uncertainty": math.radians(0.5), "distance_uncertainty": 2e-4}
    weights, angles, distances = measured(1.0)
    found = identify_crease(STRIP, weights, angles=angles, distances=distances, **uncertainties)
    # Three standard deviations; they themselves are below 0.1 rad.
    assert abs(found.rest_angle - 1.9) < 3 * found.rest_angle_error < 0.1
    assert abs(found.stiffness - 3e-3) < 3 * found.stiffness_error < 1e-3
    # The misfit of eight data less two parameters is about 1.
    assert 0.2 < found.misfit < 2.5


@pytest.mark.parametrize(
    "change, words",
    [
        ({"weights": [1e-3]}, "1 weights, 4 angles and 4 distances"),
        ({"weights": [-1.0, 1e-3, 2e-3, 3e-3]}, "negative weights"),
    ],
)
def test_measurements_that_cannot_be(change: dict[str, object], words: str) -> None:
    call = dict(zip(("weights", "angles", "distances"), measured(0.0), strict=True))
    with pytest.raises(gx.InputError, match=words):
        identify_crease(STRIP, **(call | change))


def hanging_plate(weight: float, cells: int = 16) -> tuple[float, float]:
    """Angle of the crease [rad] and distance of the ends [m] of a strip of polyimide, `HUNG`, under
    its own weight and one at its end [N]; down is x, and the left end turns freely."""
    plate = gx.Plate(
        creased_strip(MPI.COMM_SELF, cells, 3, HUNG.length, HUNG.width),
        POLYIMIDE,
        hinges=["crease"],
        displacement=crease.folded(HUNG_REST),
    )
    hinge = gx.connectors.Crease(plate, "crease", stiffness=HUNG_STIFFNESS, rest_angle=HUNG_REST)
    items = [plate, hinge, gx.Fixed(plate, "left"), gx.Gravity(plate, (GRAVITY, 0.0, 0.0))]
    if weight:
        force = (weight / HUNG.width, 0.0, 0.0)
        items.append(gx.loads.EdgeLoad(plate, "right", force=force))
    search = at_rest(*items)
    x = search.system.unknowns.q0.array_r.reshape(-1, 3)
    left, right = (x[plate.nodes(side)].mean(axis=0) for side in ("left", "right"))
    return gx.probes.FoldAngle(hinge).of(search.system), float(np.linalg.norm(right - left))


POLYIMIDE = gx.Linear(E=3.0e9, nu=0.3, density=1420.0, thickness=50e-6)
# A strip whose width is large compared with √(radius × thickness) bends as a wide plate does.
HUNG = HangingStrip(
    0.05,
    0.015,
    bending_stiffness=POLYIMIDE.E * POLYIMIDE.thickness**3 / 12 / (1 - POLYIMIDE.nu**2),
    area_density=POLYIMIDE.density * POLYIMIDE.thickness,
)
# The values that are to be identified: rest angle [rad] and stiffness [N m/m/rad].
HUNG_REST = math.radians(105.0)
HUNG_STIFFNESS = 3e-3


@pytest.mark.slow
def test_the_crease_of_a_plate_is_identified_from_its_measured_shapes() -> None:
    weights = (0.0, 2e-4, 5e-4, 1e-3, 2e-3, 4e-3)
    # Standard deviations of what a ruler measures [rad], [m].
    angle_error = math.radians(0.5)
    distance_error = 2e-4
    random = np.random.default_rng(0)
    angles, distances = np.array([hanging_plate(weight) for weight in weights]).T
    found = identify_crease(
        HUNG,
        weights,
        angles=angles + angle_error * random.normal(size=len(weights)),
        distances=distances + distance_error * random.normal(size=len(weights)),
        angle_uncertainty=angle_error,
        distance_uncertainty=distance_error,
    )
    # Within three standard deviations.
    assert abs(found.rest_angle - HUNG_REST) < 3 * found.rest_angle_error
    assert abs(found.stiffness - HUNG_STIFFNESS) < 3 * found.stiffness_error
    assert found.misfit < 1.5

"""Manufacturing errors of a folded tube move its folds, turn its panels and change its sizes as
they say."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from demos.common import flat_rooted_tube
from demos.common.manufacturing import (
    LARGEST,
    Scatter,
    Specimen,
    UnevenZigzag,
    draw_specimen,
    move_rows,
    stations,
)
from demos.common.tube_bending import bent_tube, straight_stiffness
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.presets.films import KAPTON_HN

LENGTH = 0.25
DIAMETER = 0.03
ANGLE = math.radians(80.0)
SHIFTS = (2e-3, -1e-3)
ERRORS = (math.radians(3.0), math.radians(-2.0))
LAW = KAPTON_HN.law(25e-6, residual_stiffness=1e-6)
PERFECT = Specimen((0.0, 0.0), (0.0, 0.0), 1.0, (1.0, 1.0, 1.0))


def uneven(**changes):
    given = {"shifts": SHIFTS, "angle_errors": ERRORS, **changes}
    return UnevenZigzag(length=LENGTH, panels=3, angle=ANGLE, **given)


def test_without_errors_it_is_the_zigzag_of_the_package() -> None:
    rng = np.random.default_rng(1)
    X = np.column_stack([rng.uniform(0, LENGTH, 50), rng.uniform(-0.02, 0.02, 50), np.zeros(50)])
    side = rng.choice([-1.0, 0.0, 1.0], 50)
    sheets = {"width": 0.047, "opening": 1e-3, "lift": 1e-4}
    ideal = gx.fold.Zigzag(length=LENGTH, panels=3, angle=ANGLE, **sheets)
    measured = uneven(shifts=(), angle_errors=(), **sheets).place(X, side)
    assert measured == pytest.approx(ideal.place(X, side), abs=1e-12)


def test_folds_are_shifted_and_panels_are_turned_by_the_errors_so_far() -> None:
    ends = LENGTH * np.array([0, 1, 2, 3]) / 3 + np.array([0.0, *SHIFTS, 0.0])
    X = np.column_stack([ends, np.zeros(4), np.zeros(4)])
    corners = uneven().place(X, np.zeros(4))
    panels = np.diff(corners, axis=0)
    lengths = np.linalg.norm(panels, axis=1)
    assert lengths == pytest.approx(np.diff(ends), rel=1e-12)
    slopes = np.arctan2(panels[:, 2], panels[:, 0])
    # The first fold turns the second panel down by 2 ANGLE and its error; the second one turns the
    # third panel up.
    expected = [ANGLE, -ANGLE - ERRORS[0], ANGLE - ERRORS[0] + ERRORS[1]]
    assert slopes == pytest.approx(expected, abs=1e-12)


@pytest.mark.mpi
def test_creases_have_the_angles_and_positions_of_the_specimen(comm) -> None:
    mesh = flat_tube(comm, LENGTH, DIAMETER, 4, compartments=3)
    ends = stations(LENGTH, 3, SHIFTS)
    folds = uneven()
    film = gx.Membrane(folds.mark(move_rows(mesh, LENGTH, ends)), LAW)
    creases = folds.creases(film, stiffness=1e-3)
    angles = {crease.edges: abs(crease.rest_angle) for crease in creases}
    for sheet in ("top", "bottom"):
        for fold, error in enumerate(ERRORS, start=1):
            assert angles[f"fold {fold} {sheet}"] == pytest.approx(2 * ANGLE + error, abs=1e-5)
    nodes = film.nodes("ring 1")
    X = film.space.tabulate_dof_coordinates()[nodes]
    farthest = comm.allreduce(float(np.abs(X[:, 0] - ends[1]).max(initial=0.0)))
    assert farthest < 1e-12


def test_a_seed_is_one_specimen_and_the_seed_zero_is_as_drawn(comm) -> None:
    scatter = Scatter(fold_position=1e-3, fold_angle=0.03, diameter=0.01, thickness=0.05)
    assert draw_specimen(0, 3, scatter) == PERFECT
    assert draw_specimen(7, 3, scatter) == draw_specimen(7, 3, scatter)
    many = [draw_specimen(seed, 3, scatter) for seed in range(1, 400)]
    shifts = np.array([one.fold_shifts for one in many])
    diameters = np.array([one.diameter_ratio for one in many])
    # Normal numbers cut at two standard deviations have 0.93 of the deviation or less, and no mean.
    assert shifts.std() == pytest.approx(0.95e-3, rel=0.1)
    assert abs(shifts).max() <= LARGEST * 1e-3
    assert diameters.mean() == pytest.approx(1.0, abs=2e-3)
    assert diameters.std() == pytest.approx(0.0095, rel=0.15)
    other = draw_specimen(1, 3, scatter)
    assert other != many[1]


def test_a_specimen_with_errors_begins_to_deploy_and_conserves_energy(comm) -> None:
    case = flat_rooted_tube.build(comm, seed=3, crease=0.02, yield_angle=0.3)
    specimen = draw_specimen(3, 3, flat_rooted_tube.SCATTER)
    film = next(item for item in case.scene.items if isinstance(item, gx.Membrane))
    assert (
        film.space.mesh.geometry.x[:, 1].max() <= specimen.diameter_ratio * math.pi * 0.0075 + 1e-9
    )
    run = case.simulation([])
    run.run(until=3e-4 if comm.size == 1 else 1e-4)
    assert abs(run.energy_error) < 1e-10 and abs(run.mass_error) < 1e-13


def test_errors_that_cannot_be_are_refused() -> None:
    with pytest.raises(gx.InputError, match="give a smaller scatter"):
        stations(0.25, 3, (0.2, 0.0))
    with pytest.raises(
        gx.InputError, match="shifts has 1 numbers; give one for each of the 2 folds"
    ):
        uneven(shifts=(1e-3,))


@pytest.mark.parametrize(("pressure", "tolerance"), [(7e3, 0.04), (7e4, 0.015)])
def test_a_tube_bends_as_a_straight_one(comm, pressure: float, tolerance: float) -> None:
    """The flat ends leave a tube of low pressure slightly oval; at ten times the pressure the
    closed form is met."""
    measured = bent_tube(comm, LAW, LENGTH, DIAMETER, pressure, PERFECT).bending_stiffness
    expected = straight_stiffness(LAW, DIAMETER, pressure)
    assert measured == pytest.approx(expected, rel=tolerance)


def test_stiffness_follows_thickness_and_the_third_power_of_the_diameter(comm) -> None:
    """Thickness of the middle panel counts, where the deflection is fitted; relative to one on the
    same mesh."""
    plain = bent_tube(comm, LAW, LENGTH, DIAMETER, 7e4, PERFECT).bending_stiffness
    wide = Specimen((0.0, 0.0), (0.0, 0.0), 1.05, (1.0, 1.0, 1.0))
    thick = Specimen((0.0, 0.0), (0.0, 0.0), 1.0, (1.1, 1.1, 1.1))
    of_wide = bent_tube(comm, LAW, LENGTH, DIAMETER, 7e4, wide).bending_stiffness
    of_thick = bent_tube(comm, LAW, LENGTH, DIAMETER, 7e4, thick).bending_stiffness
    assert of_wide / plain == pytest.approx(1.05**3, rel=0.02)
    assert of_thick / plain == pytest.approx(1.1, rel=0.02)


def test_the_tip_of_a_short_tube_is_as_stiff_as_the_pressure(comm) -> None:
    """The flat end is a hinge whose moment comes from the pressure: softer than a cantilever."""
    short = 0.16
    low = bent_tube(comm, LAW, short, DIAMETER, 8e3, PERFECT).tip_stiffness
    assert 1.5 < bent_tube(comm, LAW, short, DIAMETER, 16e3, PERFECT).tip_stiffness / low <= 2.0
    cantilever = 3 * straight_stiffness(LAW, DIAMETER, 8e3) / short**3
    assert low < 0.05 * cantilever

"""Creases on films: conservation through the flat state, with yielding and folds pressed shut;
checkpoints."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.crease import folded
from demos.studies.thrown_crease import LAW, LENGTH, STIFFNESS, WIDTH, thrown
from gossamer_fx.mechanics.connectors.crease import MOUNTAIN, VALLEY
from gossamer_fx.mechanics.connectors.crease_energies import CreaseEnergies
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.records.fields.fields import FieldFunctions
from tests.small_scenes import at_rest, run_until, spin_drift

WORLD = MPI.COMM_WORLD
throw = partial(thrown, 1.0)


def strip(
    comm: MPI.Comm, order: int = 2, angle: float = 1.4, velocity: object = None, **options: object
) -> tuple[gx.Membrane, gx.connectors.Crease]:
    mesh = creased_strip(comm, 4, 2, LENGTH, WIDTH)
    film = gx.Membrane(mesh, LAW, order=order, displacement=folded(angle), velocity=velocity)
    return film, gx.connectors.Crease(film, "crease", **({"stiffness": STIFFNESS} | options))


def angles(run: gx.Simulation, crease: gx.connectors.Crease) -> np.ndarray:
    (creases,) = [
        terms for terms in run.system.equations.compiled if isinstance(terms, CreaseEnergies)
    ]
    return creases.angles(crease.energy)[0]


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_a_thrown_strip_conserves_energy_and_angular_momentum(comm: MPI.Comm, order: int) -> None:
    run = gx.Simulation(gx.Scene(*strip(comm, order, velocity=throw)), gx.Midpoint(dt=2e-4))
    # k θ²/2 for each metre of crease.
    assert run.first.stored["crease"] == pytest.approx(STIFFNESS * WIDTH * 1.4**2 / 2)
    run.run(until=6e-3)
    assert run.substeps == 0
    assert abs(run.energy_error) < 1e-10
    assert spin_drift(run) < 1e-10


def test_a_stiff_crease_snaps_through_flat() -> None:
    film, crease = strip(MPI.COMM_SELF, stiffness=0.04)
    run = gx.Simulation(gx.Scene(film, crease), gx.Midpoint(dt=5e-5))
    least = 0.0
    while run.time < 2e-3:
        run.run(until=run.time + 1e-4)
        least = min(least, float(angles(run, crease).min()))
    # Negative: the fold has passed the flat state to the other side.
    assert least < -0.05
    assert run.substeps == 0
    assert abs(run.energy_error) < 1e-9


def test_a_rest_angle_that_yields_dissipates() -> None:
    """Panels that turn about a crease at rest make it yield, and its loss counts as dissipated."""
    c = math.cos(0.7)
    s = math.sin(0.7)
    fling = lambda X: 200.0 * np.stack([s * X[0], 0 * X[0], -c * abs(X[0])])  # noqa: E731
    film, crease = strip(MPI.COMM_SELF, velocity=fling, rest_angle=1.4, yield_angle=0.3)
    run = run_until(2e-3, film, crease, dt=1e-4)
    (creases,) = [
        terms for terms in run.system.equations.compiled if isinstance(terms, CreaseEnergies)
    ]
    θ, rest = creases.angles(crease.energy)
    assert (rest < 1.3).all()
    assert (np.abs(θ - rest) <= 0.3 + 1e-12).all()
    # of a rest angle that moves one way, the loss is the yield moment times its way
    k = STIFFNESS * WIDTH / len(rest)
    assert run.totals.dissipated == pytest.approx(0.3 * k * float((1.4 - rest).sum()), rel=0.2)
    assert run.totals.losses == {"crease": run.totals.dissipated}
    assert run.totals.dissipated >= 0.3 * k * float((1.4 - rest).sum()) * (1 - 1e-12)
    assert abs(run.energy_error) < 1e-10


@pytest.mark.parametrize("sign", [VALLEY, MOUNTAIN])
def test_a_fold_pressed_shut_opens_to_its_side(sign: int) -> None:
    film, crease = strip(MPI.COMM_SELF, angle=math.pi, rest_angle=sign * 2.0)
    run = gx.Simulation(gx.Scene(film, crease), gx.Midpoint(dt=1e-4))
    np.testing.assert_allclose(angles(run, crease), sign * math.pi)
    # Fold angle ±π against a rest angle of ±2 rad.
    assert run.first.stored["crease"] == pytest.approx(STIFFNESS * WIDTH * (math.pi - 2) ** 2 / 2)
    run.run(until=1e-3)
    # Below π: the fold has opened; it starts at 3.14.
    assert (np.abs(angles(run, crease)) < 3.0).all()
    assert (angles(run, crease) * sign > 0).all()


@pytest.mark.mpi
def test_the_field_of_fold_angles(comm: MPI.Comm) -> None:
    film, crease = strip(comm)
    run = gx.Simulation(gx.Scene(film, crease), gx.Midpoint(dt=1e-4))
    fields = FieldFunctions(run.system, film, ["fold_angle"])
    fields.update()
    (values,) = fields.functions
    n = film.mesh.domain.topology.index_map(2).size_local
    folds = values.x.array[values.function_space.dofmap.list[:n]].mean(axis=1)
    measured = comm.allreduce(int(np.isclose(folds, 1.4).sum()))
    assert measured == 4  # two edges, each with two triangles
    assert comm.allreduce(int((folds == 0).sum())) == 32 - 4
    assert gx.probes.FoldAngle(crease)(run) == pytest.approx(1.4)
    assert gx.probes.FoldAngle(crease, "largest")(run) == pytest.approx(1.4)
    assert gx.probes.FoldAngle(crease, "rest")(run) == 0.0
    with pytest.raises(gx.InputError, match="'crease' is not in the scene"):
        gx.probes.FoldAngle(crease).of(gx.Scene(film).compile())


def thrown_plate(angle: float = 1.4) -> tuple[gx.Plate, gx.connectors.Crease]:
    mesh = creased_strip(MPI.COMM_SELF, 4, 1, LENGTH, WIDTH)
    plate = gx.Plate(mesh, LAW, hinges=["crease"], displacement=folded(angle), velocity=throw)
    return plate, gx.connectors.Crease(plate, "crease", stiffness=STIFFNESS)


@pytest.mark.parametrize(
    "control", [None, gx.StepControl(target_iterations=6, error=2e-6, max_step=1e-4)]
)
def test_a_thrown_plate_conserves_energy_and_angular_momentum(
    control: gx.StepControl | None,
) -> None:
    run = run_until(5e-3, *thrown_plate(), dt=5e-5, control=control)
    assert abs(run.energy_error) < 1e-10
    assert spin_drift(run) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(
    "control", [None, gx.StepControl(target_iterations=6, error=2e-6, max_step=1e-4)]
)
def test_a_thrown_plate_conserves_for_ten_thousand_steps(control: gx.StepControl | None) -> None:
    """Folding to and fro through flat."""
    plate, crease = thrown_plate()
    run = gx.Simulation(gx.Scene(plate, crease), gx.Midpoint(dt=5e-5), control=control)
    angle = gx.probes.FoldAngle(crease)
    seen = []
    while run.step < 10_000:
        run.run(until=run.time + 2.5e-3)
        seen.append(angle(run))
    # It has passed the flat state both ways.
    assert min(seen) < -0.2 and max(seen) > 0.2
    assert abs(run.energy_error) < 1e-9
    assert spin_drift(run) < 1e-10


def test_modes_of_a_creased_plate_are_softer_than_of_a_flat_one() -> None:
    """The second frequency of a held strip falls where a crease lets its free half flap."""
    found = []
    for stiffness in (1e-5, 1.0):
        plate = gx.Plate(creased_strip(MPI.COMM_SELF, 4, 1, LENGTH, WIDTH), LAW, hinges=["crease"])
        search = at_rest(
            plate,
            gx.connectors.Crease(plate, "crease", stiffness=stiffness),
            gx.Fixed(plate, "left"),
        )
        found.append([mode.frequency for mode in gx.analysis.modes(search, 3)])
    # A crease of 1e-5 N m/m/rad is almost a free hinge, one of 1 almost rigid.
    assert found[0][1] < 0.9 * found[1][1]


def yielding(comm: MPI.Comm) -> tuple[gx.Membrane, gx.connectors.Crease]:
    """Shut to the side that its rest angle does not tell, and beyond its limit from the start."""
    return strip(comm, angle=math.pi, velocity=throw, initial_fold=MOUNTAIN, yield_angle=0.5)


@pytest.mark.mpi
def test_turns_and_rest_angles_are_in_checkpoints_on_any_number_of_ranks(folder: Path) -> None:
    whole = run_until(4e-4, *yielding(WORLD), dt=1e-4)
    run_until(2e-4, *yielding(WORLD), dt=1e-4, checkpoints=gx.Checkpoints(folder))
    WORLD.barrier()
    for comm in (WORLD, MPI.COMM_SELF):
        rest = run_until(4e-4, *yielding(comm), dt=1e-4, restart=folder)
        measured = rest.totals.stored["crease"]
        # A restart on other ranks sums in another order; yielding amplifies that.
        assert measured == pytest.approx(whole.totals.stored["crease"], rel=1e-8)
        assert rest.totals.dissipated == pytest.approx(whole.totals.dissipated, rel=1e-8)
        assert rest.totals.kinetic == pytest.approx(whole.totals.kinetic, rel=1e-8)


def two_surfaces(model: object) -> None:
    """Two squares side by side, the normal of the second turned."""
    occ = model.occ  # type: ignore[attr-defined]
    one = occ.addRectangle(0, 0, 0, 1, 1)
    other = occ.addRectangle(1, 0, 0, 1, 1)
    occ.fragment([(2, one)], [(2, other)])
    occ.synchronize()
    model.addPhysicalGroup(2, [one, other], name="film")  # type: ignore[attr-defined]
    line = next(
        c
        for _, c in model.getEntities(1)  # type: ignore[attr-defined]
        if len(model.getAdjacencies(1, c)[0]) == 2  # type: ignore[attr-defined]
    )
    model.addPhysicalGroup(1, [line], name="crease")  # type: ignore[attr-defined]
    model.mesh.generate(2)  # type: ignore[attr-defined]
    model.mesh.reverse([(2, other)])  # type: ignore[attr-defined]


BAD = {
    "no hinge": (
        lambda film: gx.connectors.Crease(gx.Plate(film.mesh, LAW), "crease", stiffness=1e-3),
        "transmits bending at 'crease' itself; give it hinges=['crease']",
    ),
    "rim": (
        lambda film: gx.connectors.Crease(film, "left", stiffness=1e-3),
        "2 of the 2 edges of 'left' lie on the rim",
    ),
    "surface": (
        lambda film: gx.connectors.Crease(film, "film", stiffness=1e-3),
        "the group 'film' has dimension 2; name curves",
    ),
    "no group": (
        lambda film: gx.connectors.Crease(film, "fold", stiffness=1e-3),
        "on 'film': the mesh has no group 'fold'",
    ),
    "stiffness": (
        lambda film: gx.connectors.Crease(film, "crease", stiffness=-1e-3),
        "stiffness is -0.001 N m/m/rad; give a positive",
    ),
    "rest angle": (
        lambda film: gx.connectors.Crease(film, "crease", stiffness=1e-3, rest_angle=3.2),
        "rest_angle is 3.2 rad; give a number between",
    ),
    "yield": (
        lambda film: gx.connectors.Crease(film, "crease", stiffness=1e-3, yield_angle=-1.0),
        "yield_angle is -1.0 rad; give a",
    ),
    "shut": (
        lambda film: gx.connectors.Crease(film, "crease", stiffness=1e-3, initial_fold=0),
        "initial_fold is 0; give 1 or -1",
    ),
    "normals": (
        lambda film: gx.connectors.Crease(
            gx.Membrane(gx.gmsh_mesh(two_surfaces, WORLD), LAW),
            "crease",
            stiffness=1e-3,
        ),
        "the normals of 'film' change sides at 'crease'",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_creases_are_refused_in_a_sentence(case: str) -> None:
    make, words = BAD[case]
    film = gx.Membrane(creased_strip(WORLD, 4, 2, LENGTH, WIDTH), LAW)
    with pytest.raises(gx.InputError) as caught:
        make(film)
    assert words in str(caught.value)
    assert str(caught.value).endswith(".")

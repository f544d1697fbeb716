"""Contact pressure as a field: its integral is the force, on any number of ranks, for orders 1 and
2."""

from __future__ import annotations

import basix
import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.records.fields.fields import FieldFunctions
from tests.contact.scenes import FILM, SIGMA, film, simulate


def integral(body, function: fem.Function) -> float:
    return float(
        body.comm.allreduce(fem.assemble_scalar(fem.form(function * ufl.dx(body.space.mesh))))
    )


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_pressure_integrates_to_the_force(comm, order) -> None:
    body = film(comm, 2, height=2e-5, order=order, name="film")

    def softly(t: float) -> float:
        # Smooth from 0 to 4 Pa in 10 ms, so that the film does not bounce.
        y = min(t / 0.01, 1.0)
        return -4.0 * y * y * (3 - 2 * y)

    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    contact = gx.Contact(body, floor, distance=2e-4, stiffness=1e8)
    run = simulate([contact, gx.Pressure(body, softly)], 0.014, 5e-4)
    assert run.totals.stored["contact"] > 0
    fields = FieldFunctions(run.system, body, ["contact_pressure"])
    fields.update()
    (alone,) = fields.functions
    beside = FieldFunctions(run.system, body, ["stress1", "contact_pressure"])
    beside.update()
    # The same field in another set of fields.
    assert integral(body, beside.functions[1]) == pytest.approx(integral(body, alone), rel=1e-12)
    assert alone.x.array.min(initial=0.0) >= 0
    largest = gx.probes.ContactPressure(contact, body)(run)
    assert largest == pytest.approx(alone.x.array.max(), rel=1e-9)
    # The whole film lies on the floor.
    assert gx.probes.ContactArea(contact, body)(run) == pytest.approx(0.01, rel=1e-12)
    assert integral(body, alone) == pytest.approx(4.0 * 0.01, rel=0.05)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_uniform_load_has_a_uniform_pressure(comm, order) -> None:
    body = film(comm, 3, height=8e-4, order=order, name="film")
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    contact = gx.Contact(body, floor, distance=1e-3, stiffness=1e7)
    held = [
        gx.Fixed(body, "bottom left", components=(0, 1)),
        gx.Fixed(body, "bottom right", components=(1,)),
    ]
    equilibrium = gx.Equilibrium(gx.Scene(contact, gx.Gravity(body, (0.0, 0.0, -500.0)), *held))
    equilibrium.find(progress=False)
    _, values = gx.fields.field_values(equilibrium, body=body, field="contact_pressure")
    assert values == pytest.approx(np.full(len(values), 500.0 * SIGMA), rel=1e-5)
    area = gx.probes.ContactArea(contact, body)
    assert area(equilibrium) == pytest.approx(0.01, rel=1e-12)
    # The load does not bend the film: contact carries it where it acts.
    z = equilibrium.system.unknowns.state[body].function().x.array[2::3]
    lowest = comm.allreduce(float(z.min()), op=MPI.MIN)
    highest = comm.allreduce(float(z.max()), op=MPI.MAX)
    assert lowest > 4e-4
    assert highest - lowest < 1e-9


@pytest.mark.mpi
def test_a_cable_of_order_2_lies_evenly(comm) -> None:
    points = [(0.0, 0.0, 2e-3), (0.5, 0.0, 2e-3), (1.0, 0.0, 2e-3)]
    law = gx.CableLaw(EA=1e3, line_density=0.1)
    cable = gx.Cable(line(comm, points, 4), law, order=2, name="cable")
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    contact = gx.Contact(cable, floor, distance=1e-3, stiffness=1e7, radius={"cable": 1e-3})
    held = [
        gx.Fixed(cable, "start", components=(0, 1)),
        gx.Fixed(cable, "end", components=(0, 1)),
    ]
    equilibrium = gx.Equilibrium(gx.Scene(contact, gx.Gravity(cable, (0.0, 0.0, -10.0)), *held))
    equilibrium.find(progress=False)
    _, values = gx.fields.field_values(equilibrium, body=cable, field="contact_pressure")
    # 1 N/m over a diameter of 2 mm.
    assert values == pytest.approx(np.full(len(values), 500.0), rel=1e-5)


@pytest.mark.mpi
def test_the_gap_of_a_curved_film_is_none_that_it_does_not_have(comm) -> None:
    """A ball of eight cells round its girth above a plane: its surface bulges over the pieces."""
    height = 0.112
    ball = gx.Membrane(
        sphere(comm, 0.1, 8, order=2),
        gx.Miyazaki(**FILM),
        order=2,
        displacement=lambda X: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] + height]),
    )
    plane = gx.contact.Plane(point=(0, 0, 0), normal=(0.3, 0.2, 1.0))
    contact = gx.Contact(ball, plane, distance=5e-3)
    run = gx.Simulation(gx.Scene(ball, contact), gx.Midpoint(dt=1e-6))
    run.run(until=1e-6)
    normal = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    x = run.system.unknowns.state[ball].function().x.array.reshape(-1, 3)
    cells = ball.space.dofmap.list
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.triangle, 2)
    lattice = basix.create_lattice(basix.CellType.triangle, 12, basix.LatticeType.equispaced, True)
    shape = element.tabulate(0, lattice)[0, :, :, 0]
    surface = np.einsum("qa,cai->cqi", shape, x[cells]) @ normal
    true_gap = comm.allreduce(float(surface.min(initial=np.inf)), op=MPI.MIN)
    nodes_gap = comm.allreduce(float((x @ normal).min(initial=np.inf)), op=MPI.MIN)
    stated = gx.probes.ContactGap(contact)(run)
    assert nodes_gap > true_gap + 1e-4
    assert true_gap - 3 * (nodes_gap - true_gap) < stated <= true_gap


@pytest.mark.mpi
def test_pressure_is_that_of_the_force_that_the_step_used(comm) -> None:
    body = film(comm, 2, height=2e-4, order=1, name="film")
    floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
    contact = gx.Contact(body, floor, distance=1e-4, stiffness=1e8)
    # A film that falls at 0.1 m/s touches and leaves the floor within a few of these steps.
    run = simulate([contact, gx.Pressure(body, -40.0)], 5e-3, 1e-4)
    push = gx.probes.ContactForce(contact, body, axis="z")
    fields = FieldFunctions(run.system, body, ["contact_pressure"])
    forces = []
    for step in range(1, 11):
        run.run(until=5e-3 + step * 1e-4)
        fields.update()
        forces.append(push(run))
        assert integral(body, fields.functions[0]) == pytest.approx(forces[-1], rel=1e-6, abs=1e-12)
    assert max(forces) > 0


@pytest.mark.mpi
def test_a_restart_knows_the_force_of_its_state(comm, folder) -> None:
    def pressed(**options):
        body = film(comm, 2, height=2e-4, order=1, name="film")
        floor = gx.contact.Plane(point=(0, 0, 0), normal=(0, 0, 1))
        contact = gx.Contact(body, floor, distance=1e-4, stiffness=1e8)
        run = simulate([contact, gx.Pressure(body, -40.0)], 1e-3, 1e-4, **options)
        push = gx.probes.ContactForce(contact, body, axis="z")(run)
        return push, gx.probes.ContactPressure(contact, body)(run)

    assert pressed(checkpoints=gx.Checkpoints(folder / "kept"))[0] > 0
    push, pressure = pressed(restart=folder / "kept")
    # The film is flat, of 0.01 m², with the same pressure on all nodes.
    assert push == pytest.approx(0.01 * pressure, rel=1e-9) and push > 0


@pytest.mark.mpi
def test_pressure_is_zero_where_nothing_touches(comm) -> None:
    one = film(comm, 2, name="one")
    other = film(comm, 2, height=0.01, name="other")
    floor = gx.contact.Plane(point=(0, 0, -1), normal=(0, 0, 1))
    contact = gx.Contact(one, floor, distance=1e-3)
    run = simulate([contact, other], 1e-4)
    assert gx.probes.ContactArea(contact, one)(run) == 0
    assert gx.probes.ContactPressure(contact, one)(run) == 0
    with pytest.raises(gx.InputError, match="'other' is not a body of 'contact', which has: one"):
        gx.probes.ContactArea(contact, other)
    for body in (one, other):
        fields = FieldFunctions(run.system, body, ["contact_pressure"])
        fields.update()
        assert not np.abs(fields.functions[0].x.array).max(initial=0.0)

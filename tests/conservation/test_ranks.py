"""A scene on all ranks has the results of the scene on one rank."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.films.spinning_sheet import throw
from demos.inflatables.inflate_tube import FILM, NITROGEN
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube


def spinning(comm: MPI.Intracomm) -> gx.Scene:
    law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
    return gx.Scene(gx.Membrane(sheet(comm, 10, 10), law, velocity=throw))


def filling(comm: MPI.Intracomm) -> gx.Scene:
    film = gx.Membrane(flat_tube(comm, 0.4, 0.06, 6), FILM)
    tube = gx.Chamber(
        film,
        gas=NITROGEN,
        pressure=1.0,
        temperature=293.0,
        dead_volume=1e-6,
        name="tube",
    )
    tank = gx.Tank(20e-6, gas=NITROGEN, pressure=1.5e6, temperature=293.0)
    return gx.Scene(film, tube, gx.Orifice(tank, tube, area=math.pi * 1e-4**2))


def positions_by_node(run: gx.Simulation) -> dict[int, np.ndarray]:
    """Positions of the owned nodes by their number in the mesh file."""
    film = next(body for body in run.system.unknowns.bodies if isinstance(body, gx.Membrane))
    domain = film.mesh.domain
    owned = film.block.index_map.size_local
    number = np.zeros(owned + film.block.index_map.num_ghosts, dtype=np.int64)
    number[film.space.dofmap.list.ravel()] = domain.geometry.input_global_indices[
        geometry_nodes(domain).ravel()
    ]
    return dict(
        zip(
            number[:owned].tolist(),
            run.system.unknowns.q0.array_r.reshape(-1, 3)[:owned],
            strict=True,
        )
    )


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("scene, dt", [(spinning, 1e-3), (filling, 1e-4)], ids=["sheet", "tube"])
def test_round_off_grows_but_the_ledger_closes(comm, scene, dt: float) -> None:
    """A film that switches amplifies round-off: printed is how fast."""
    runs = [gx.Simulation(scene(c), gx.Midpoint(dt=dt)) for c in (comm, MPI.COMM_SELF)]
    for step in (20, 50, 100, 200):
        for run in runs:
            run.run(until=step * dt)
        here, alone = (positions_by_node(run) for run in runs)
        difference = comm.allreduce(
            max(np.abs(x - alone[node]).max() for node, x in here.items()), op=MPI.MAX
        )
        if comm.rank == 0:
            print(f"after {step} steps positions differ by {difference:.1e} m")
    assert all(abs(run.energy_error) < 1e-10 for run in runs)
    assert runs[0].totals.energy == pytest.approx(runs[1].totals.energy, rel=1e-9)

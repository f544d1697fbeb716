"""Pictures of films behind others, and of films coloured by group."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.records.fields.fields import groups_of
from gossamer_fx.records.plot.camera import aim, render
from gossamer_fx.records.plot.colours import colouring, group_table
from tests.small_scenes import WRINKLING

ABOVE = {"azimuth": 0.0, "elevation": np.pi / 2}


def film(comm, height=0.0, name="film", **given):
    lift = lambda X: np.vstack([0 * X[0], 0 * X[0], 0 * X[0] + height])  # noqa: E731
    return gx.Membrane(sheet(comm, 3, 3, **given), WRINKLING, name=name, displacement=lift)


def middle(folder, films):
    """The pixel in the middle of a picture from above, coloured by group; on rank 0."""
    comm = films[0].comm
    fields = {one.name: ("displacement", "group") for one in films}
    recording = gx.Recording(folder, fields=fields)
    gx.Simulation(gx.Scene(*films), gx.Midpoint(dt=1e-3), outputs=[recording]).run(until=0.0)
    if comm.rank > 0:
        return None
    run = gx.plot.RunReader(folder)
    colours = colouring(run, "group")
    shapes = [colours.shape(run, 0)]
    image = next(render(aim(shapes, gx.plot.View(**ABOVE)), shapes, 40.0, colours))
    return image[image.shape[0] // 2, image.shape[1] // 2]


@pytest.mark.mpi(1)
def test_the_nearer_film_hides_the_other(comm, folder):
    low = film(comm, 0.0, "low")
    high = film(comm, 0.1, "high")
    alone = [
        middle(folder / one.name, [one])
        for one in (film(comm, 0.0, "low"), film(comm, 0.1, "high"))
    ]
    both = middle(folder / "both", [low, high])
    if comm.rank == 0:
        table = group_table(2)
        upper = alone[0].max() / table[0].max() * table[1]
        assert np.allclose(alone[0], alone[1], atol=1e-12)  # each is the first of its scene
        assert np.allclose(both, upper, atol=0.02)


def test_groups_are_those_that_are_seen(comm):
    tube = gx.Membrane(flat_tube(comm, 0.3, 0.03, 4, compartments=3), WRINKLING, name="tube")
    names, [parts] = groups_of([tube])
    assert names == ["compartment 1", "compartment 2", "compartment 3"]  # they cover top and bottom
    counts = comm.allreduce(np.bincount(parts, minlength=3))
    assert counts.min() == counts.max() > 0
    names, parts = groups_of([film(comm, name="a"), film(comm, name="b")])
    assert names == ["a", "b"] and all((part == k).all() for k, part in enumerate(parts))

"""The stress-free shape of an inflatable reflector that is a paraboloid under pressure, by exact
derivatives.

A dish of film with a fixed rim is inflated.  Made as the paraboloid z = (r² - a²)/(4 f) that it
shall be, it is stretched by the pressure to another shape.  `gx.analysis.fit` changes its
stress-free shape, its cutting pattern, until points of the inflated meridian are where those of the
paraboloid are.

Varied are amounts of a few changes of the mesh, polynomials of the radius.  The gradient of a
result with respect to all nodes of the mesh costs one transposed solve, and so does each row of the
Jacobian.  Newton's method is needed here: a rim that is too wide by 20 µm moves the dish by half a
micrometre only, so that methods with gradients only, as those of `gx.analysis.minimise`, take
hundreds of equilibria.

The solution is known.  Where the film is the paraboloid, statics give its tensions (per length),
with the principal radii R1 = 2 f/cos³φ along the meridian and R2 = 2 f/cos φ around the axis, tan φ
= r/(2 f):

    2 π r N1 sin φ = π r² p          equilibrium of the cap below r, thus N1 = p R2/2
    N1/R1 + N2/R2 = p                equilibrium across the film, thus N2 = p R2 (1 - R2/(2 R1))

Both are positive, so that nothing wrinkles.  With the stretches λ1 and λ2, strains e = (λ² - 1)/2
and the law of the film, N1 = λ1/λ2 S1, N2 = λ2/λ1 S2 and E t e1 = S1 - ν S2, E t e2 = S2 - ν S1
give both stretches at each r, and these the stress-free meridian,

    R(r) = r/λ2,    dZ/dr = sqrt((ds/dr)²/λ1² - (dR/dr)²),    ds/dr = 1/cos φ,    Z(a) = 0.

Where the values come from:
    diameter 1 m, f/D = 1   chosen
    film                    polyimide, Kapton HN 100 (DuPont data sheet H-38492): 25 µm, 2.5 GPa,
                            0.34
    pressure 100 Pa         chosen; the film is strained by 0.1 %

    ./gossamer demo reflector
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI
from numpy.polynomial import Legendre

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save
from gossamer_fx.extend import Array, geometry_nodes
from gossamer_fx.meshes.disc import quarter_disc
from gossamer_fx.presets.films import KAPTON_HN

RADIUS = 0.5  # of the rim, a [m]
FOCAL_LENGTH = 1.0  # f [m]
THICKNESS = 25e-6  # m
PRESSURE = 100.0  # Pa
LAW = KAPTON_HN.law(THICKNESS, residual_stiffness=1e-4)

# Polynomials of the radius for the moves outwards, and as many for those along z.
POLYNOMIALS = 3
# Sizes of the changes [m]: about what the pressure moves the film by.
SIZE = 1e-3


def paraboloid(r: Array) -> Array:
    """Height [m] over the plane of the rim."""
    return (r**2 - RADIUS**2) / (4 * FOCAL_LENGTH)


@dataclass(frozen=True)
class Meridian:
    """The exact stress-free meridian, as a table over the radius r of the inflated film.

    Attributes:
        r: of the inflated film (n,) [m].
        R: stress-free radius (n,) [m].
        Z: stress-free height over the plane of the rim (n,) [m].
        stretches: λ1 along the meridian and λ2 around the axis (2, n).
    """

    r: Array
    R: Array
    Z: Array
    stretches: Array


def exact_meridian(points: int = 4001) -> Meridian:
    """The stress-free meridian of a film that is the paraboloid under pressure; see the module."""
    r = np.linspace(0.0, RADIUS, points)
    # In the middle all meridians meet, and R2 is the limit 2 f.
    cosine = 1 / np.sqrt(1 + (r / (2 * FOCAL_LENGTH)) ** 2)
    R1 = 2 * FOCAL_LENGTH / cosine**3
    R2 = 2 * FOCAL_LENGTH / cosine
    N1 = PRESSURE * R2 / 2
    N2 = PRESSURE * R2 * (1 - R2 / (2 * R1))
    stiffness = LAW.E * LAW.thickness
    λ1 = np.ones_like(r)
    λ2 = np.ones_like(r)
    # Each iteration reduces the error by the strain, a thousandth.
    for _ in range(12):
        S1 = N1 * λ2 / λ1
        S2 = N2 * λ1 / λ2
        λ1 = np.sqrt(1 + 2 * (S1 - LAW.nu * S2) / stiffness)
        λ2 = np.sqrt(1 + 2 * (S2 - LAW.nu * S1) / stiffness)
    R = r / λ2
    slope_of_R = np.gradient(R, r, edge_order=2)
    slope_of_Z = np.sqrt(np.maximum(1 / (cosine * λ1) ** 2 - slope_of_R**2, 0.0))
    steps = (slope_of_Z[1:] + slope_of_Z[:-1]) / 2 * np.diff(r)
    Z = np.concatenate([[0.0], np.cumsum(steps)])
    return Meridian(r, R, Z - Z[-1], np.array([λ1, λ2]))


def build(comm: MPI.Intracomm, cells: int, order: int) -> tuple[gx.Membrane, gx.Equilibrium]:
    """A quarter of the dish, made as the paraboloid, and its equilibrium under pressure."""
    mesh = quarter_disc(comm, cells, RADIUS, order=order)
    x = mesh.domain.geometry.x
    x[:, 2] = paraboloid(np.hypot(x[:, 0], x[:, 1]))
    film = gx.Membrane(mesh, LAW, order=order, name="dish")
    held = [
        gx.Fixed(film, "rim"),
        gx.Fixed(film, "x axis", components=(1,)),
        gx.Fixed(film, "y axis", components=(0,)),
    ]
    # The normal points upwards, the pressure downwards.
    scene = gx.Scene(film, *held, gx.Pressure(film, -PRESSURE))
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-10))

    return film, equilibrium


def meridian_points(film: gx.Membrane, cells: int) -> tuple[list[gx.probes.Position], list[float]]:
    """Coordinates x and z of mesh nodes on the x axis as results, and their values on the
    paraboloid [m]."""
    results = []
    values = []
    # The nodes on the x axis are evenly spaced.  The middle does not move along x, and the rim not
    # at all.
    intervals = cells * film.order
    for k in range(intervals):
        r = RADIUS * k / intervals
        z = float(paraboloid(np.array(r)))
        port = film.port_at((r, 0.0, z))
        if k:
            results.append(gx.probes.Position(port, "x"))
            values.append(r)
        results.append(gx.probes.Position(port, "z"))
        values.append(z)
    return results, values


def changes(film: gx.Membrane, polynomials: int) -> Array:
    """The changes of the mesh nodes of this rank (k, 2 polynomials), each of about `SIZE`.

    The first half moves nodes outwards by (r/a) P_2j(r/a), the others along z by P_2j(r/a) - 1, so
    that the rim stays in its plane, with the Legendre polynomials P of even degree.
    """
    points = film.mesh.domain.geometry.x
    nodes = np.zeros(film.block.index_map.size_local + film.block.index_map.num_ghosts, dtype=int)
    nodes[film.space.dofmap.list.ravel()] = geometry_nodes(film.mesh.domain).ravel()
    own = points[nodes[: film.block.index_map.size_local]]
    ratio = np.hypot(own[:, 0], own[:, 1]) / RADIUS
    columns = []
    for j in range(polynomials):
        outwards = np.zeros_like(own)
        outwards[:, :2] = own[:, :2] / RADIUS * Legendre.basis(2 * j)(ratio)[:, None]
        columns.append(outwards)
    for j in range(1, polynomials + 1):
        along_z = np.zeros_like(own)
        along_z[:, 2] = Legendre.basis(2 * j)(ratio) - 1
        columns.append(along_z)
    return np.array([SIZE * column.ravel() for column in columns]).T


def deviation(film: gx.Membrane, equilibrium: gx.Equilibrium) -> Array:
    """Distance (n,) [m] along z of the inflated film from the paraboloid, at the owned nodes."""
    x = equilibrium.system.unknowns.state[film].positions()
    return x[:, 2] - paraboloid(np.hypot(x[:, 0], x[:, 1]))


def root_mean_square(comm: MPI.Intracomm, values: Array) -> float:
    """Of the values of all ranks."""
    total = comm.allreduce(float((values**2).sum()))
    return float(np.sqrt(total / comm.allreduce(len(values))))


def main(
    cells: int = 20,
    order: int = 2,
    polynomials: int = POLYNOMIALS,
    iterations: int = 20,
    output: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Find the shape; with `output`, a folder, a picture of it.

    Args:
        cells: edges along a radius.
        order: of the film and of its mesh.
        polynomials: for the moves outwards, and along z.
        iterations: of the fit at most.
        output: folder of the picture.
        comm: the communicator.

    Returns:
        The rms distances from the paraboloid of a dish that is made as one, and of the one that was
        found, after inflation; rms and largest error of the stress-free meridian against the exact
        one.
    """
    began = time.process_time()
    film, equilibrium = build(comm, cells, order)
    equilibrium.find()
    before = deviation(film, equilibrium)
    radii = np.hypot(*equilibrium.system.unknowns.state[film].positions()[:, :2].T)
    first = (radii, before)
    results, values = meridian_points(film, cells)
    found = gx.analysis.fit(
        equilibrium,
        of=results,
        measured=values,
        by=["dish.shape"],
        # A fit of all points alike: any value gives the same shape.
        uncertainty=1e-6,
        basis={"dish.shape": changes(film, polynomials)},
        iterations=iterations,
    )
    after = deviation(film, equilibrium)
    shape = found.parameters["dish.shape"].reshape(-1, 3)
    R = np.hypot(shape[:, 0], shape[:, 1])
    exact = exact_meridian()
    # Below the rim's own radius only: a mesh may end a little outside of it.
    errors = shape[:, 2] - np.interp(R, exact.R, exact.Z)
    naive = paraboloid(exact.R) - exact.Z
    if output is not None and comm.size == 1:
        radii = np.hypot(*equilibrium.system.unknowns.state[film].positions()[:, :2].T)
        draw([first, (radii, after)], R, errors, exact, Path(output) / "reflector.png")
    rim = float(R.max(initial=0.0))
    return {
        "off the paraboloid, made as one [µm]": 1e6 * root_mean_square(comm, before),
        "off the paraboloid, optimised [µm]": 1e6 * root_mean_square(comm, after),
        "meridian error, rms [µm]": 1e6 * root_mean_square(comm, errors),
        "meridian error, largest [µm]": 1e6
        * comm.allreduce(float(np.abs(errors).max(initial=0.0)), op=MPI.MAX),
        "meridian off the paraboloid [µm]": 1e6 * float(np.abs(naive).max()),
        "rim error [µm]": 1e6 * abs(comm.allreduce(rim, op=MPI.MAX) - float(exact.R[-1])),
        "iterations": found.iterations,
        "unknowns": equilibrium.system.unknowns.numbering.size,
        "seconds": time.process_time() - began,
    }


def draw(
    inflated: Sequence[tuple[Array, Array]],
    R: Array,
    errors: Array,
    exact: Meridian,
    path: Path,
) -> None:
    """Deviation of the inflated film from the paraboloid, and the stress-free meridian with its
    error."""
    figure = new_figure(11.0, 3.8)
    deviations, meridian, error = figure.subplots(1, 3)
    names = ("made as the paraboloid", "stress-free shape optimised")
    for (radii, heights), name, colour in zip(inflated, names, (RED, BLUE), strict=True):
        deviations.plot(radii, 1e3 * heights, ".", ms=3, color=colour, label=name)
    finish(deviations, "r [m]", "inflated film above the paraboloid [mm]")
    meridian.plot(exact.R, 1e3 * (exact.Z - paraboloid(exact.R)), color=GREY, label="exact")
    # The error is the difference from the exact meridian.
    found = errors + np.interp(R, exact.R, exact.Z) - paraboloid(R)
    meridian.plot(R, 1e3 * found, ".", ms=3, color=BLUE, label="found")
    finish(meridian, "R [m]", "stress-free film above the paraboloid [mm]")
    error.plot(R, 1e6 * errors, ".", ms=3, color=BLUE)
    finish(error, "R [m]", "error of the stress-free height [µm]")
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(output="out/reflector"))

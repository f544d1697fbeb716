"""Outputs of a run: fields, probes, pictures; complete also after a failure, and no files if the
run is refused."""

from __future__ import annotations

import contextlib
import csv
import io
import logging
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.records.fields.fields import FieldFunctions
from gossamer_fx.records.fields.film_states import AreaFractions
from gossamer_fx.records.outputs.vtu import read_records
from gossamer_fx.records.outputs.vtu_format import read_vtu
from gossamer_fx.records.plot.rasterise import Canvas
from tests.hanging import HANG_TIMEOUT
from tests.small_scenes import LINEAR, run_until

COMM = MPI.COMM_WORLD
E = 1e9
NU = 0.3
LAW = gx.Miyazaki(E=E, nu=NU, density=1400.0, thickness=1e-4, residual_stiffness=1e-4)
G = 9.81
V0 = np.array([0.5, -0.25, 1.0])
DT = 1e-3


@cache
def small_sheet() -> gx.Mesh:
    return sheet(COMM, 3, 4)


def falling_film() -> gx.Membrane:
    return gx.Membrane(small_sheet(), LAW, velocity=lambda x: np.outer(V0, np.ones(x.shape[1])))


def strained(
    order: int = 1, n: int = 6, stretch: object = None, comm: MPI.Comm = COMM
) -> gx.Membrane:
    """E22 = -1e-3 everywhere; E11 = 1e-2, 1e-3, -1e-3 on x < 1/6, < 1/2, < 1: taut, wrinkled, slack
    (ν = 0.3)."""

    def displacement(x: np.ndarray) -> np.ndarray:
        λ = np.sqrt(
            1 + 2 * np.array([1e-2, 1e-3, -1e-3, -1e-3])
        )  # stretches of E11 and, last, of E22
        widths = [np.clip(x[0], a, b) - a for a, b in ((0, 1 / 6), (1 / 6, 1 / 2), (1 / 2, 1))]
        return np.vstack(
            [sum(w * (s - 1) for w, s in zip(widths, λ, strict=False)), x[1] * (λ[3] - 1), 0 * x[2]]
        )

    return gx.Membrane(sheet(comm, n, n), LAW, order=order, displacement=displacement)


def fall(film: gx.Membrane, outputs: list, steps: int = 5) -> gx.Simulation:
    return run_until(steps * DT, film, gx.Gravity(film, (0, 0, -G)), dt=DT, outputs=outputs)


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open() as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))


# ---- fields --------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("E11", "E22", "S11", "S22", "state"),
    [
        (2e-3, 1e-3, 2.5274725e-3, 1.7582418e-3, TAUT),
        (2e-3, -1.5e-3, 1.9999730e-3, -9.0000810e-8, WRINKLED),
        (-1e-3, -2e-3, -1.0000600e-7, -2.0000300e-7, SLACK),
    ],
)
def test_principal_values_of_a_uniform_strain(
    order: int, E11: float, E22: float, S11: float, S22: float, state: int
) -> None:
    """A film that is stretched and then turned in space; the direction of stress turns with it.

    The stresses are those of the potential of `Miyazaki` (IJNME 66 (2006) 1179, eqs. 13-20, with
    the ratios (1, u) where the film is wrinkled and (u, u) where it is slack), evaluated by hand
    for u = 1e-4.
    """
    U = np.diag(np.sqrt(1 + 2 * np.array([E11, E22, 0.0])))
    angle = 0.7
    axis = np.array([1.0, 2.0, 2.0]) / 3
    K = np.cross(np.eye(3), axis)
    R = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    film = gx.Membrane(
        sheet(COMM, 2, 3),
        LAW,
        order=order,
        displacement=lambda x: (R @ U - np.eye(3)) @ x,
    )
    system = gx.Scene(film).compile()
    fields = FieldFunctions(
        system,
        film,
        [
            "strain1",
            "strain2",
            "second_piola_stress1",
            "second_piola_stress2",
            "direction",
            "state",
        ],
    )
    fields.update()
    values = {f.name: f.x.array for f in fields.functions}
    assert np.allclose(values["strain1"], E11, atol=1e-12) and np.allclose(
        values["strain2"], E22, atol=1e-12
    )
    assert np.allclose(values["second_piola_stress1"], S11 * E, atol=1e-6 * abs(S11) * E)
    assert np.allclose(values["second_piola_stress2"], S22 * E, atol=1e-6 * abs(S11) * E)
    assert np.all(values["state"] == state)
    along = values["direction"].reshape(-1, 3) @ (R @ [1, 0, 0])
    assert np.allclose(abs(along), 1, atol=1e-9)


def test_direction_is_a_unit_vector_where_the_principal_strains_coincide() -> None:
    film = gx.Membrane(sheet(COMM, 2, 2), LAW, displacement=lambda x: 1e-3 * x)
    system = gx.Scene(film).compile()
    fields = FieldFunctions(system, film, ["direction"])
    fields.update()
    assert np.allclose(np.linalg.norm(fields.functions[0].x.array.reshape(-1, 3), axis=1), 1)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_area_fractions_of_a_prescribed_strain(order: int) -> None:
    film = strained(order)
    slack, wrinkled, taut = AreaFractions([film])(gx.Scene(film).compile())
    assert np.allclose((slack, wrinkled, taut), (1 / 2, 1 / 3, 1 / 6), atol=1e-12)


def test_a_linear_film_is_taut() -> None:
    film = gx.Membrane(sheet(COMM, 2, 2), gx.Linear(E=E, nu=NU, density=1.0, thickness=1e-4))
    assert AreaFractions([film])(gx.Scene(film).compile())[TAUT] == 1


# ---- VTU -----------------------------------------------------------------------------------------


@pytest.mark.mpi
def test_fields_hold_the_motion_at_every_due_step(folder: Path) -> None:
    """A free fall: u = V0 t - ½ g t², which the midpoint rule meets exactly."""
    outputs = [
        gx.outputs.VTU(folder / "motion.pvd", fields=("displacement", "velocity"), every=2),
        gx.outputs.VTU(
            folder / "states.pvd",
            fields=("displacement", "state", "stress1"),
            times=(3 * DT,),
        ),
    ]
    fall(falling_film(), outputs)
    COMM.barrier()
    if COMM.rank == 0:
        [motion] = read_records(folder / "motion.pvd")
        assert np.allclose(motion.times, np.array([0, 2, 4, 5]) * DT, atol=1e-15)
        for t, files in zip(motion.times, map(motion.files, range(len(motion.times))), strict=True):
            assert len(files) == COMM.size
            for file, mesh in zip(files, motion.meshes, strict=True):
                grid = read_vtu(file)
                fallen = V0 * t - [0, 0, G * t**2 / 2]
                assert set(grid.arrays) == {"displacement [m]", "velocity [m/s]"}
                assert np.allclose(grid.arrays["displacement [m]"], fallen, atol=1e-10)
                assert np.allclose(grid.arrays["velocity [m/s]"], V0 - [0, 0, G * t], atol=1e-8)
                assert np.allclose(grid.points, read_vtu(mesh).points + fallen, atol=1e-10)
        [states] = read_records(folder / "states.pvd")
        assert np.allclose(states.times, [0, 3 * DT, 5 * DT], atol=1e-15)
        last = read_vtu(states.files(2)[0])
        # Of a film of order 1 they are constant in each cell.
        assert set(last.cell_arrays) == {"state", "stress1 [Pa]"}
        assert np.all(last.cell_arrays["state"] == TAUT)


@pytest.mark.mpi
def test_unknown_field_is_refused_before_anything_is_written(folder: Path) -> None:
    with pytest.raises(gx.InputError, match=r"no field 'sress1'.*displacement, velocity, strain1"):
        fall(falling_film(), [gx.outputs.VTU(folder / "a.pvd", fields=("sress1",))])
    with pytest.raises(gx.InputError, match="a list whose entries are each a word"):
        gx.outputs.VTU(folder / "a.pvd", fields="state")
    with pytest.raises(gx.InputError, match=r"\.pvd"):
        gx.outputs.VTU(folder / "a.vtu")
    with pytest.raises(gx.InputError, match="not a body of the scene"):
        fall(falling_film(), [gx.outputs.VTU(folder / "a.pvd", body=falling_film())])
    assert not any(folder.iterdir())


@pytest.mark.mpi
def test_a_later_refusal_leaves_an_old_file_as_it_was(folder: Path) -> None:
    fall(falling_film(), [gx.outputs.VTU(folder / "a.pvd")], steps=1)
    COMM.barrier()
    before = (folder / "a_files" / "00001.vtu").stat().st_mtime_ns
    with pytest.raises(gx.InputError):
        fall(
            falling_film(),
            [
                gx.outputs.VTU(folder / "a.pvd"),
                gx.outputs.VTU(folder / "b.pvd", fields=("nothing",)),
            ],
        )
    assert (folder / "a_files" / "00001.vtu").stat().st_mtime_ns == before


@pytest.mark.mpi(1)
@pytest.mark.parametrize("kind", ["VTU", "Probes", "Picture"])
def test_folder_that_cannot_be_written(folder: Path, kind: str) -> None:
    if COMM.rank == 0:
        (folder / "file").write_text("")
    COMM.barrier()
    output = {
        "VTU": lambda: gx.outputs.VTU(folder / "file" / "a.pvd"),
        "Probes": lambda: gx.outputs.Probes(folder / "file" / "a.csv", {"one": lambda run: 1.0}),
        "Picture": lambda: gx.plot.Picture(folder / "file" / "a.png"),
    }[kind]()
    with pytest.raises(gx.InputError, match="Cannot write"):
        fall(falling_film(), [output])


# ---- probes --------------------------------------------------------------------------------------


@pytest.mark.mpi
def test_probes_follow_a_falling_film(folder: Path) -> None:
    film = falling_film()
    corner = film.port("top right")
    fall(
        film,
        [
            gx.outputs.Probes(
                folder / "probes.csv",
                {
                    "x": gx.probes.Position(corner, "x"),
                    "z": gx.probes.Displacement(corner, "z"),
                    "w": gx.probes.Velocity(corner, "z"),
                    "taut": gx.probes.AreaFraction(film, "taut"),
                    "kinetic": lambda run: run.totals.kinetic,
                },
                every=2,
                times=(),
            )
        ],
    )
    COMM.barrier()
    found = table(folder / "probes.csv")
    t = found["time"]
    assert found["step"].tolist() == [0, 2, 4, 5]
    assert np.allclose(t, found["step"] * DT, atol=1e-15)
    assert np.allclose(found["x"], 1 + V0[0] * t, atol=1e-10)
    assert np.allclose(found["z"], V0[2] * t - G * t**2 / 2, atol=1e-10)
    assert np.allclose(found["w"], V0[2] - G * t, atol=1e-8)
    assert np.all(found["taut"] == 1)
    v = np.linalg.norm(V0 - np.outer(G * t, [0, 0, 1]), axis=1)
    assert np.allclose(found["kinetic"], 0.5 * 1400 * 1e-4 * v**2, rtol=1e-8)


@pytest.mark.mpi
def test_a_series_keeps_the_numbers_of_every_step() -> None:
    film = falling_film()
    series = gx.Series({"z": gx.probes.Displacement(film.port("top right"), "z")})
    fall(film, [series])
    assert np.allclose(series.time, DT * np.arange(6), atol=1e-15)
    assert np.allclose(series["z"], V0[2] * series.time - G * series.time**2 / 2, atol=1e-10)
    with pytest.raises(gx.InputError, match=r"The series has no probe 'x'; its probes are: z\."):
        series["x"]


@pytest.mark.mpi
def test_gas_probes_give_the_state_of_the_chamber(folder: Path) -> None:
    """A rigid tank that nothing leaves keeps p V = m R T."""
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    tank = gx.Tank(1e-3, gas=gas, pressure=2e5, temperature=300.0)
    run = run_until(
        2 * DT,
        tank,
        gx.PointMass(1.0),
        dt=DT,
        outputs=[
            gx.outputs.Probes(
                folder / "gas.csv",
                {
                    q: gx.probes.GasState(tank, q)
                    for q in ("pressure", "temperature", "volume", "mass")
                },
            )
        ],
    )
    COMM.barrier()
    found = table(folder / "gas.csv")
    assert np.allclose(found["pressure"], 2e5) and np.allclose(found["temperature"], 300)
    assert np.allclose(found["volume"], 1e-3)
    assert np.allclose(found["mass"], 2e5 * 1e-3 / (287.0 * 300))
    with pytest.raises(gx.InputError, match=r"no chamber 'bag'.*tank"):
        run.chamber("bag")


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("probe", "words"),
    [
        (lambda run: float("nan"), "returns nan"),
        (
            lambda run: np.float64("inf"),
            "it returns inf; record its inverse, lambda run: 1 / probe",
        ),
        (lambda run: 1 / 0, "ZeroDivisionError"),
        (lambda run: "much", "it returns 'much'"),
        (gx.probes.Position(falling_film().port("top right"), "x"), "not in the scene"),
    ],
)
def test_bad_probe_is_named_before_the_first_step(folder: Path, probe: object, words: str) -> None:
    with pytest.raises(gx.InputError, match=f"Probe 'tip'.*{words}"):
        fall(falling_film(), [gx.outputs.Probes(folder / "a.csv", {"tip": probe})])
    COMM.barrier()  # rank 0 removes the lock
    assert not any(folder.iterdir())


@pytest.mark.mpi
def test_probe_that_differs_between_ranks_is_named(folder: Path) -> None:
    outputs = [gx.outputs.Probes(folder / "a.csv", {"rank": lambda run: 1.0 + run.comm.rank})]
    if COMM.size == 1:
        fall(falling_film(), outputs)
        return
    with pytest.raises(gx.InputError, match="rank to rank"):
        fall(falling_film(), outputs)


@pytest.mark.parametrize(
    "bad",
    [
        lambda p: gx.probes.Position(p, "w"),
        lambda p: gx.outputs.Probes("a.csv", {"time": len}),
        lambda p: gx.Series({"z": p}),
    ],
)
def test_bad_requests_of_probes(bad: object) -> None:
    with pytest.raises(gx.InputError):
        bad(falling_film().port("top right"))


@pytest.mark.mpi
def test_outputs_are_complete_after_a_failure(folder: Path) -> None:
    """A probe that fails in the fourth step ends the run; what was before it is there."""
    film = falling_film()
    outputs = [
        gx.outputs.VTU(folder / "a.pvd"),
        gx.plot.Picture(folder / "a.png", times=(2 * DT, 5 * DT)),
        gx.outputs.Probes(
            folder / "a.csv", {"t": lambda run: run.time if run.step < 4 else float("inf")}
        ),
    ]
    with pytest.raises(gx.InputError, match=r"Probe 't' at t = 0.004 s: it returns inf"):
        fall(film, outputs)
    COMM.barrier()
    assert table(folder / "a.csv")["step"].tolist() == [0, 1, 2, 3]
    assert (folder / "a.png").stat().st_size > 10_000
    if COMM.rank == 0:
        [part] = read_records(folder / "a.pvd")
        assert len(part.times) == 5


# ---- pictures ------------------------------------------------------------------------------------


def test_triangles_leave_no_pixel_out(comm: MPI.Comm) -> None:
    """A triangulated rectangle covers the pixels whose centres lie in it, and no others."""
    rng = np.random.default_rng(3)
    nx = 9
    ny = 7
    x, y = np.meshgrid(np.linspace(7.3, 90.8, nx), np.linspace(5.2, 60.1, ny))
    x[1:-1, 1:-1] += rng.uniform(-3, 3, (ny - 2, nx - 2))
    y[1:-1, 1:-1] += rng.uniform(-2, 2, (ny - 2, nx - 2))
    points = np.stack([x, y, 0 * x + 1], axis=2).reshape(-1, 3)
    corner = (np.arange(nx - 1) + nx * np.arange(ny - 1)[:, None]).ravel()
    triangles = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + nx], 1),
            np.stack([corner + nx + 1, corner + 1, corner + nx], 1),
        ]
    )
    canvas = Canvas(70, 100, 0.0, 2.0)
    palette = np.zeros((1, 256, 3), dtype=np.uint8)
    canvas.draw(
        points[triangles],
        np.ones((len(triangles), 3)),
        np.zeros(len(triangles), dtype=np.int64),
        palette,
    )
    black = canvas.outlined(np.inf, 0.0)[..., 0] == 0
    u = np.arange(100) + 0.5
    v = np.arange(70) + 0.5
    inside = ((u > 7.3) & (u < 90.8)) & ((v > 5.2) & (v < 60.1))[:, None]
    assert np.array_equal(black, inside)


def test_the_nearer_triangle_hides_the_farther_where_they_cross() -> None:
    """Planes z = x and z = 50 over a square of 100 pixels cross in the middle, in whatever order
    they are drawn."""
    square = np.array([[[0, 0], [100, 0], [0, 100]], [[100, 100], [100, 0], [0, 100]]], dtype=float)
    slope = np.concatenate([square, square[..., :1]], axis=2)
    flat = np.concatenate([square, np.full((2, 3, 1), 50.0)], axis=2)
    palette = np.zeros((2, 256, 3), dtype=np.uint8)
    palette[1] = 255
    images = []
    for order in ((slope, flat), (flat, slope)):
        canvas = Canvas(100, 100, 0.0, 100.0)
        for triangles in order:
            canvas.draw(
                triangles,
                np.ones((2, 3)),
                np.full(2, int(triangles is flat), dtype=np.int64),
                palette,
            )
        images.append(canvas.outlined(np.inf, 0.0)[..., 0])
    assert np.array_equal(*images)
    assert np.all(images[0][:, :50] == 0) and np.all(images[0][:, 50:] == 1)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_picture_is_the_same_on_any_number_of_ranks(folder: Path, order: int) -> None:
    """Pixel by pixel, of the start alone: curves of later errors differ by round-off."""
    from matplotlib.image import imread

    own = folder / f"own{COMM.rank}.png"
    together = folder / "together.png"
    for comm, path in ((MPI.COMM_SELF, own), (COMM, together)):
        film = strained(order, comm=comm)
        run_until(0.0, film, dt=DT, outputs=[gx.plot.Picture(path, title="start")])
    COMM.barrier()
    a = imread(own)
    b = imread(together)
    assert a.shape == b.shape
    error = (abs(a - b).max(axis=2) > 0.01).sum()
    assert error <= 20
    for colour in (
        (0.18, 0.49, 0.75),
        (0.96, 0.65, 0.14),
    ):  # slack and wrinkled film is seen in its colour
        hue = (a[..., :3] / a[..., :3].max(axis=2, keepdims=True)) - np.array(colour) / max(colour)
        assert (abs(hue).max(axis=2) < 0.1).mean() > 0.01


def test_picture_of_gas_alone(folder: Path) -> None:
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    first, second = (
        gx.Tank(1e-3, gas=gas, pressure=p, temperature=300.0, name=name)
        for p, name in ((2e5, "full"), (1e3, "empty"))
    )
    scene = gx.Scene(gx.Orifice(first, second, area=1e-6), gx.PointMass(1.0))
    run = gx.Simulation(scene, gx.Midpoint(dt=DT), outputs=[gx.plot.Picture(folder / "gas.png")])
    run.run(until=5 * DT)
    assert (folder / "gas.png").stat().st_size > 10_000


def test_too_many_times_are_refused() -> None:
    with pytest.raises(gx.InputError, match="at most 24"):
        gx.plot.Picture("a.png", times=np.linspace(0, 1, 100))
    with pytest.raises(gx.InputError, match=r"times is \(0.1, nan\); give a list"):
        gx.plot.Picture("a.png", times=(0.1, float("nan")))


def test_matplotlib_is_loaded_by_pictures_only(folder: Path) -> None:
    """A film without a picture computes and records without it."""
    code = f"""
import sys
import gossamer_fx as gx
from mpi4py import MPI
from gossamer_fx.meshes.sheet import sheet

film = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), gx.Linear(E=1e9, nu=0.3, density=1e3, thickness=1e-4))
outputs = [gx.outputs.VTU({str(folder / "a.pvd")!r}), gx.Ledger({str(folder / "a.csv")!r}), gx.outputs.Progress()]
gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3), outputs=outputs).run(until=1e-3)
loaded = [name for name in ("matplotlib", "gossamer_fx.mechanics.gas.network") if name in sys.modules]
sys.exit(f"loaded: {{loaded}}" if loaded else 0)
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=HANG_TIMEOUT)


@pytest.mark.mpi
def test_fields_of_one_file_share_one_element() -> None:
    film = falling_film()
    system = gx.Scene(film).compile()
    for names, nodes in ((["displacement", "velocity"], 1), (["displacement", "state"], 3)):
        functions = FieldFunctions(system, film, names).functions
        cells = film.mesh.domain.topology.index_map(2).size_global
        sizes = {f.function_space.dofmap.index_map.size_global for f in functions}
        expected = {3 * cells} if nodes == 3 else {film.block.index_map.size_global}
        assert sizes == (expected)
        assert all(isinstance(f, fem.Function) for f in functions)


# ---- what a run says -----------------------------------------------------------------------------


class Terminal(io.StringIO):
    """What a person sees."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_one_line_and_anything_else_lines() -> None:
    seen = {
        Terminal(): ("h 0.001 s", "100%, 0 s left"),
        io.StringIO(): ("t = 0.005 of 0.005 s",),
    }
    for stream, words in seen.items():
        fall(falling_film(), [gx.outputs.Progress(stream, seconds=0.0)])
        said = stream.getvalue()
        for word in (*words, "step 5", "ledger", "5 steps in", "energy closes to"):
            assert word in said
        assert ("\r" in said) == isinstance(stream, Terminal)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full disk of Linux")
def test_a_log_that_cannot_be_written_is_reported_once(capsys: pytest.CaptureFixture[str]) -> None:
    log = logging.getLogger("gossamer_fx")
    gx.run.log_to(COMM, "/dev/full", quiet=True)
    try:
        log.info("first")
        log.info("second")
    finally:
        for handler in list(log.handlers):
            log.removeHandler(handler)
            with contextlib.suppress(OSError):
                handler.close()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "gossamer: The log '/dev/full' cannot be written (No space left on device)" in said


@pytest.mark.mpi
def test_the_log_is_written_by_one_rank_and_kept_from_a_quiet_terminal(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = logging.getLogger("gossamer_fx")
    gx.run.log_to(COMM, folder / "run.log", quiet=True)
    try:
        film = falling_film()
        events = [gx.At(2 * DT, name="half-way"), gx.At(4 * DT, stop=True, name="enough")]
        run = run_until(1.0, film, dt=DT, events=events)
        log.warning("something is odd")
        log.warning("rank %d is odd", COMM.rank, extra={"every_rank": True})
    finally:
        for handler in list(log.handlers):
            log.removeHandler(handler)
            handler.close()
    COMM.barrier()
    written = (folder / "run.log").read_text().splitlines()
    measured = [line.split(maxsplit=3)[2:] for line in written[:2]]
    expected = [["INFO", "half-way at t = 0.002 s"], ["INFO", "enough at t = 0.004 s"]]
    assert measured == expected
    assert sum("something is odd" in line for line in written) == 1
    assert run.step == 4
    assert "half-way" not in capsys.readouterr().err
    COMM.barrier()


@pytest.mark.parametrize(
    "output",
    [
        lambda options: gx.Recording("run", **options),
        lambda options: gx.outputs.VTU("a.pvd", **options),
        lambda options: gx.outputs.Probes("a.csv", {"one": lambda run: 1.0}, **options),
        lambda options: gx.reduction.Snapshots(gx.Membrane(sheet(COMM, 1, 1), LINEAR), **options),
    ],
)
def test_steps_and_times_of_records_are_not_asked_for_together(output):
    """The steps were ignored in silence."""
    with pytest.raises(gx.InputError, match="every is 2, but there are times, too"):
        output({"every": 2, "times": [1e-3]})
    assert output({"times": [1e-3]}).schedule.times == (1e-3,)
    assert output({"every": 2}).schedule.every == 2

"""Equilibria and modes are written and read like runs, and a search says how it goes and stops when
asked."""

from __future__ import annotations

import math
import os
import signal
from dataclasses import replace
from html import escape

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis import modes
from gossamer_fx.analysis.statics import remedies
from gossamer_fx.analysis.statics.continuation import SearchProgress, SearchState
from gossamer_fx.app.cli.command import main
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.records.plot.curve_panels import run_curves
from tests.small_scenes import at_rest

LAW = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)


def drum(comm, *others, **options):
    film = gx.Membrane(sheet(comm, 4, 4), LAW, initial_stress=1e6, name="drum")
    load = gx.Pressure(film, lambda t: 10.0 + 10.0 * t)
    supports = [gx.Fixed(film, edge) for edge in EDGES]
    return gx.Equilibrium(gx.Scene(film, load, *supports, *others), **options), film


# ---- records -------------------------------------------------------------------------------------


@pytest.mark.mpi
def test_an_equilibrium_is_recorded_as_a_run_is(comm, folder):
    equilibrium, film = drum(comm)
    result = equilibrium.find()
    recording = gx.Recording(folder / "drum", title="Drum")
    gx.outputs.record(equilibrium, [recording, gx.outputs.VTU(folder / "drum.pvd", film)])
    comm.barrier()
    reader = gx.plot.RunReader(folder / "drum")
    assert reader.kind == "equilibrium"
    assert reader.about["status"] == "finished"
    assert reader.about["result"]["iterations"] == result.iterations
    height = gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")(equilibrium)
    segment, step = next(iter(reader.bodies.values())).at(0)
    assert segment.positions(step)[:, 2].max() == pytest.approx(height, rel=1e-12)
    if comm.rank == 0:
        gx.plot.field(reader, "stress1", times=[0.0], path=folder / "drum.png")
        gx.write_report(reader, folder / "drum.html")
        page = (folder / "drum.html").read_text()
        assert escape(result.summary()) in page
        assert "by the jumps of the load" in page
    comm.barrier()


def test_the_command_draws_an_equilibrium_without_curves(folder):
    """There is no time over which curves could be drawn, and no error because of that."""
    equilibrium, _ = drum(MPI.COMM_SELF)
    equilibrium.find()
    gx.outputs.record(equilibrium, [gx.Recording(folder / "drum")])
    assert main(["plot", str(folder / "drum")]) == 0
    pictures = {path.name for path in (folder / "drum").glob("*.png")}
    assert pictures and "curves.png" not in pictures


@pytest.mark.mpi
def test_a_path_of_loads_has_a_state_for_each_time(comm, folder):
    equilibrium, film = drum(comm)
    height = gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")
    recording = gx.Recording(folder / "path", probes={"height": height})
    ledger = gx.Ledger(folder / "ledger.csv")
    gx.outputs.record(equilibrium, [recording, ledger], at=[0.0, 1.0, 2.0], along="wind [Pa]")
    comm.barrier()
    reader = gx.plot.RunReader(folder / "path")
    assert reader.times.tolist() == [0.0, 1.0, 2.0]
    # The parameter has its name and unit in tables, captions and run.json.
    assert (reader.axis.name, reader.axis.unit) == ("wind", "Pa")
    for name in ("probes.csv", "ledger.csv", "states.csv"):
        assert next(iter(reader.table(name))) == "wind [Pa]"
    assert (folder / "ledger.csv").read_text().startswith("wind [Pa],step,")
    assert "energy_error" not in reader.table("ledger.csv")
    assert reader.caption(2, None) == "equilibrium at wind = 2 Pa"
    assert run_curves(reader).label == "wind [Pa]"
    heights = reader.table("probes.csv")["height"]
    # The film is stiffer the more it is stretched, but the load grows in equal parts.
    assert heights[0] < heights[1] < heights[2] < 3 * heights[0]
    with pytest.raises(
        gx.InputError, match=r"at is \[0\.0, 1\.0, 0\.5\], whose number 3 does not fit"
    ):
        gx.outputs.record(equilibrium, [gx.Recording(folder / "back")], at=[0.0, 1.0, 0.5])
    assert not (folder / "back").exists()


@pytest.mark.mpi
def test_a_mode_is_recorded_over_one_period(comm, folder):
    equilibrium, _ = drum(comm)
    equilibrium.find()
    before = equilibrium.system.unknowns.q0.array_r.copy()
    folders = gx.outputs.record_modes(
        equilibrium,
        modes(equilibrium, 2),
        folder / "modes",
        amplitude=0.03,
        frames=4,
    )
    assert (equilibrium.system.unknowns.q0.array_r == before).all()
    comm.barrier()
    assert [path.name for path in folders] == ["mode_1", "mode_2"]
    reader = gx.plot.RunReader(folders[0])
    assert reader.kind == "mode"
    largest = []
    for frame in range(4):
        largest.append(max(values.max() for values in reader.values("mode_amplitude", frame)))
    # A cosine at quarters of its period: the absolute amplitude is 3 cm, 0, 3 cm, 0.
    assert largest == pytest.approx([0.03, 0.0, 0.03, 0.0], abs=1e-12)
    # With its sign: the drum is up in one frame and down in another one.
    middles = []
    for frame in (0, 2):
        [heights] = reader.values("mode_amplitude_z", frame)
        middles.append(heights.flat[abs(heights).argmax()])
        [along_normal] = reader.values("mode_amplitude_normal", frame)
        assert abs(along_normal).max() == pytest.approx(0.03, rel=0.05)
    assert middles[0] == pytest.approx(-middles[1]) and abs(middles[0]) == pytest.approx(0.03)
    ledger = reader.table("ledger.csv")
    # Energy of the vibration, half kinetic and half stored in the mean.
    assert ledger["kinetic"] + ledger["stored mode"] == pytest.approx(ledger["kinetic"].max())
    if comm.rank == 0:
        gx.plot.modes(folders, folder / "modes.png")
        gx.plot.animate(reader, "mode_amplitude", path=folder / "mode.gif", seconds=0.2)
    comm.barrier()


def test_modes_of_a_cable_are_drawn_in_one_colour(tmp_path):
    cable = gx.Cable(
        line(MPI.COMM_SELF, [(0, 0, 0), (1, 0, 0)], 4), gx.CableLaw(1e3, 0.01), initial_tension=5.0
    )
    equilibrium = gx.Equilibrium(gx.Scene(cable, gx.Fixed(cable, "start"), gx.Fixed(cable, "end")))
    equilibrium.find()
    found = modes(equilibrium, 1)
    folders = gx.outputs.record_modes(equilibrium, found, tmp_path / "modes", frames=4)
    gx.plot.modes(folders, tmp_path / "modes.png")
    assert (tmp_path / "modes.png").is_file()


def test_what_cannot_be_recorded(comm, folder):
    equilibrium, _ = drum(comm)
    with pytest.raises(gx.InputError, match="no equilibrium was found yet"):
        gx.outputs.record_modes(equilibrium, [], folder / "modes")
    equilibrium.find()
    found = modes(equilibrium, 1)
    with pytest.raises(gx.InputError, match="frames is 1"):
        gx.outputs.record_modes(equilibrium, found, folder / "modes", frames=1)
    with pytest.raises(gx.InputError, match="amplitude is -1"):
        gx.outputs.record_modes(equilibrium, found, folder / "modes", amplitude=-1.0)
    with pytest.raises(gx.InputError, match="holds no record of a mode"):
        gx.outputs.record(equilibrium, [gx.Recording(folder / "run")])
        gx.plot.modes([folder / "run"], folder / "modes.png")


# ---- the search ----------------------------------------------------------------------------------


@pytest.mark.mpi
def test_a_signal_ends_a_search_with_the_last_state(comm, caplog, folder):
    """A pressure that sends the signal: the search ends after the pseudo-step, and its state can be
    recorded."""
    calls = []

    def pressure(t):
        calls.append(t)
        if len(calls) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return 100.0

    film = gx.Membrane(airbag(comm, 1.0, 6), LAW)
    scene = gx.Scene(film, gx.Pressure(film, pressure))
    equilibrium = gx.Equilibrium(scene)
    with pytest.raises(gx.run.Interrupted):
        equilibrium.find()
    if comm.rank == 0:
        assert "stopped by SIGINT" in caplog.text
    gx.outputs.record(equilibrium, [gx.Recording(folder / "stopped")])
    comm.barrier()
    captions = gx.plot.RunReader(folder / "stopped").about["captions"]
    assert captions == ["not an equilibrium: the search was stopped"]


SEARCH = SearchState(
    iterations=70,
    limit=1000,
    steps=12,
    step=3e-2,
    pseudo_time=0.4,
    residual=3.2e-2,
    tolerance=1e-8,
)


def test_progress_tells_where_the_search_stands(comm, capsys, monkeypatch):
    monkeypatch.setattr("gossamer_fx.analysis.statics.continuation.QUIET_SECONDS", -1.0)
    progress = SearchProgress(comm, unknowns=870, is_wanted=True)
    progress.update(SEARCH)
    progress.update(SEARCH)  # too early for a second line
    progress.close()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    for words in ("870 unknowns", "residual 3.2e-02 of 1e-08", "iteration 70 of at most 1000"):
        assert words in lines[0]


def test_before_the_first_pseudo_step_progress_tells_no_residual(comm, capsys, monkeypatch):
    monkeypatch.setattr("gossamer_fx.analysis.statics.continuation.QUIET_SECONDS", -1.0)
    progress = SearchProgress(comm, unknowns=870, is_wanted=True)
    progress.update(replace(SEARCH, iterations=25, residual=math.inf))
    progress.close()
    line = capsys.readouterr().err
    assert "no pseudo-step has converged yet" in line
    assert "inf" not in line


def test_what_is_not_regular_is_warned_of(comm, caplog):
    film = gx.Membrane(airbag(comm, 1.0, 4), LAW)
    gx.Equilibrium(gx.Scene(film, gx.Pressure(film, 100.0))).find()
    assert "nothing resists translation x, translation y" in caplog.text
    caplog.clear()
    equilibrium, _ = drum(comm)
    result = equilibrium.find()
    assert result.regular
    assert result.within_tolerance
    assert caplog.text == ""


# ---- remedies and gas ----------------------------------------------------------------------------

AIR = gx.IdealGas(gamma=1.4, R=287.05)
OUTSIDE = 101325.0


def bag_in_air(comm, cells, gas_volume, **options):
    """A flat bag whose gas comes from a small tank: of the volume `gas_volume` [m³] at 200 Pa above
    the outside."""
    film = gx.Membrane(airbag(comm, 1.0, cells), LAW)
    tank = 1e-3
    gas = gx.Chamber(
        film,
        gas=AIR,
        pressure=(OUTSIDE + 200) * gas_volume / tank,
        temperature=300.0,
        dead_volume=tank,
        outside=gx.gas.Ambient(OUTSIDE, 300.0),
    )
    return gx.Equilibrium(gx.Scene(film, gas), **options)


def test_isothermal_gas_in_air(comm):
    """p V = m R T0, where the adiabatic process finds no equilibrium or one at 30 K."""
    equilibrium = bag_in_air(comm, 8, 0.2, gas="isothermal")
    result = equilibrium.find()
    assert result.within_tolerance
    gas = equilibrium.chamber("chamber")
    assert gas.temperature == pytest.approx(300.0, rel=1e-12)
    assert gas.pressure * gas.volume == pytest.approx((OUTSIDE + 200) * 0.2, rel=1e-9)
    assert gas.pressure > OUTSIDE
    # Heat keeps the gas warm: the energy is that of the start.
    assert gas.internal_energy == pytest.approx((OUTSIDE + 200) * 0.2 / 0.4, rel=1e-9)


def test_held_pressure_is_that_of_a_load(comm):
    film = gx.Membrane(airbag(comm, 1.0, 6), LAW)
    loaded = at_rest(film, gx.Pressure(film, 200.0))
    bag = gx.Membrane(airbag(comm, 1.0, 6), LAW)
    gas = gx.Chamber(
        bag,
        gas=AIR,
        pressure=OUTSIDE + 200.0,
        temperature=300.0,
        dead_volume=1e-3,
        outside=gx.gas.Ambient(OUTSIDE, 300.0),
    )
    blown = gx.Equilibrium(gx.Scene(bag, gas), gas="held pressure")
    blown.find()
    held = blown.chamber("chamber")
    assert held.pressure == pytest.approx(OUTSIDE + 200.0, rel=1e-12)
    assert held.mass == pytest.approx(held.pressure * held.volume / AIR.R / 300.0, rel=1e-9)
    # Two paths to one equilibrium.
    assert blown.totals.stored["film"] == pytest.approx(loaded.totals.stored["film"], rel=1e-5)
    assert blown.totals.mass_supplied > 0


def test_remedies_by_cause(comm):
    short = gx.analysis.Continuation(total_iterations=40)
    cooled = bag_in_air(comm, 8, 0.15, search=short)
    with pytest.raises(gx.NoEquilibrium, match="expands adiabatically and has cooled from 300 K"):
        cooled.find()
    film = gx.Membrane(airbag(comm, 1.0, 4), LAW, order=2, displacement=_pillow)
    inwards = gx.Equilibrium(
        gx.Scene(film, gx.Pressure(film, 100.0)), gx.analysis.Continuation(total_iterations=3)
    )
    with pytest.raises(gx.NoEquilibrium, match=r"of order 2 and resists compression by 1e-06"):
        inwards.find()


def test_a_pressure_on_normals_that_point_inwards(comm):
    from gossamer_fx.meshes.sphere import sphere

    film = gx.Membrane(sphere(comm, 1.0, 10), LAW)
    equilibrium = gx.Equilibrium(
        gx.Scene(film, gx.Pressure(film, -100.0)), gx.analysis.Continuation(total_iterations=3)
    )
    with pytest.raises(gx.NoEquilibrium, match=r"presses the closed film 'film' together"):
        equilibrium.find()


def ellipsoid_with_rings(comm, turn, orient):
    """An ellipsoid with open polar rings, with its normals outwards or, if turned, inwards."""

    def build(model):
        occ = model.occ
        angles = np.radians(range(-80, 81, 20))
        points = [occ.addPoint(np.cos(a), 0, 0.6 * np.sin(a)) for a in angles]
        occ.revolve([(1, occ.addSpline(points))], 0, 0, 0, 0, 0, 1, 2 * np.pi)
        occ.synchronize()
        rings = []
        for _, curve in model.getEntities(1):
            _, _, low, _, _, high = model.getBoundingBox(1, curve)
            if high - low < 0.1:
                rings.append(curve)
        model.addPhysicalGroup(1, rings, name="rings")
        model.addPhysicalGroup(2, [tag for _, tag in model.getEntities(2)], name="film")
        model.mesh.setSize(model.getEntities(0), 0.3)
        model.mesh.generate(2)
        if turn:
            model.mesh.reverse()

    return gx.gmsh_mesh(build, comm, orient=orient)


def test_what_a_pressed_film_encloses_is_measured_once(comm, monkeypatch):
    """Increments of a load are many searches of one scene, whose normals stay where they are."""
    measured = []
    enclosed_by = remedies.enclosed_by

    def recorded(domain, table):
        measured.append(domain)
        return enclosed_by(domain, table)

    monkeypatch.setattr(remedies, "enclosed_by", recorded)
    film = gx.Membrane(airbag(comm, 1.0, 4), LAW, displacement=_pillow)
    scene = gx.Scene(film, gx.Pressure(film, lambda t: 100.0 + t))
    equilibrium = gx.Equilibrium(scene)
    for load in range(3):
        equilibrium.find(at=float(load))
    assert measured == [film.mesh.domain]


def test_open_rims_do_not_hide_normals_that_point_inwards(comm, caplog):
    """Rings of equal size cancel in the sum of the area vectors: the film was called closed."""
    mesh = ellipsoid_with_rings(comm, turn=True, orient=False)
    film = gx.Membrane(mesh, LAW)
    scene = gx.Scene(film, gx.Pressure(film, lambda t: 100.0), gx.Fixed(film, "rings"))
    search = gx.analysis.Continuation(total_iterations=2)
    words = r"film with small open rims 'film' together, as the normals .* point inwards"
    with pytest.raises(gx.NoEquilibrium, match=words):
        gx.Equilibrium(scene, search).find()
    if comm.rank == 0:
        # Before the search, which may take minutes.
        assert "point inwards" in caplog.records[0].message
    assert mesh.enclosed_volume() < 0


def test_orientation_gives_a_film_with_small_rims_its_outer_side(comm, caplog):
    volumes = []
    for turn in (False, True):
        mesh = ellipsoid_with_rings(comm, turn=turn, orient=True)
        volumes.append(mesh.enclosed_volume())
    # An ellipsoid without its caps, meshed coarsely.
    exact = 4 / 3 * np.pi * 0.6
    assert volumes[0] == pytest.approx(exact, rel=0.1)
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-12)
    film = gx.Membrane(mesh, LAW)
    suction = gx.Scene(film, gx.Pressure(film, -100.0), gx.Fixed(film, "rings"))
    search = gx.analysis.Continuation(total_iterations=2)
    with pytest.raises(gx.NoEquilibrium) as failure:
        gx.Equilibrium(suction, search).find()
    assert "change the sign of the pressure" in str(failure.value)
    # The mesh is oriented already.
    assert "orient=True" not in str(failure.value)
    # Suction may be meant.
    assert "presses" not in caplog.text


def _pillow(X):
    x, y, _ = X
    height = 0.1 * (1 - 4 * x**2) * (1 - 4 * y**2)
    return np.vstack([0 * x, 0 * x, height])


def test_the_reader_refuses_a_record_with_a_wrong_kind(comm, folder):
    equilibrium, _ = drum(comm)
    equilibrium.find()
    gx.outputs.record(equilibrium, [gx.Recording(folder / "drum")])
    path = folder / "drum" / "run.json"
    path.write_text(path.read_text().replace('"equilibrium"', "3", 1))
    with pytest.raises(gx.InputError, match="'kind' is 3, but must be a text"):
        gx.plot.RunReader(folder / "drum")


def test_the_size_of_the_shown_motion_is_a_share_of_the_scene(comm, folder):
    equilibrium, _ = drum(comm)
    equilibrium.find()
    found = modes(equilibrium, 1)
    folders = gx.outputs.record_modes(equilibrium, found, folder / "modes", frames=2)
    values = gx.plot.RunReader(folders[0]).values("mode_amplitude", 0)
    largest = comm.allreduce(max(float(part.max()) for part in values), MPI.MAX)
    # Five per cent of the largest dimension, 1 m.
    assert largest == pytest.approx(0.05, rel=1e-9)


@pytest.mark.parametrize("first_step", [2e-4, 2e-1])
def test_an_equilibrium_counts_no_power_times_pseudo_time(comm, first_step, tmp_path):
    """In wind, with damping of film and of a spring: nothing is supplied or dissipated, whatever
    the pseudo-steps are."""
    film = gx.Membrane(sheet(comm, 4, 4), gx.Miyazaki(3e8, 0.3, density=1200.0, thickness=5e-4))
    speed = 6.0
    wind = gx.loads.AirDrag(film, 1.225, drag_coefficient=1.2, wind=(0.0, 0.0, speed))
    middle = film.port_at((0.5, 0.5, 0.0))
    damper = gx.connectors.Damper(middle, gx.Ground((0.5, 0.5, 1.0)), damping=1.0)
    edges = [gx.Fixed(film, edge) for edge in EDGES]
    scene = gx.Scene(film, wind, gx.Damping(film, stiffness_factor=1e-3), damper, *edges)
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(first_step=first_step))
    totals = equilibrium.find().totals
    assert sum(totals.stored.values()) > 0.04
    assert totals.dissipated == 0.0
    assert totals.supplied == 0.0
    gx.outputs.record(equilibrium, [gx.Ledger(tmp_path / "ledger.csv")])
    assert "dissipated [J]" in (tmp_path / "ledger.csv").read_text()

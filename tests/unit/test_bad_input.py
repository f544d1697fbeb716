"""Invalid input is refused in one sentence that names it, before anything is computed, on any
number of ranks: arguments of public names, generated from their valid calls, and the command line.
"""

from __future__ import annotations

import logging
import re
import signal
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.app.cli.command import main
from gossamer_fx.app.cli.user_files import guarded
from gossamer_fx.core.checks.lazy_names import public_names
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.mechanics.control.feedback import Actuator
from gossamer_fx.mechanics.gas.contract import Gas
from gossamer_fx.solve.scene.scene import Item
from tests.sentences import is_line_of_command, is_sentence
from tests.small_scenes import film
from tests.unit.public_calls import UNCALLED, Call, make_inputs, method_calls, spoiled, valid_calls

WORLD = MPI.COMM_WORLD


def simulation(**options) -> gx.Simulation:
    return gx.Simulation(gx.Scene(film()), gx.Midpoint(dt=1e-3), **options)


@pytest.mark.mpi
def test_unwritable_folder(folder: Path) -> None:
    blocked = folder / "a file"
    if WORLD.rank == 0:
        blocked.write_text("")
    WORLD.barrier()
    with pytest.raises(gx.InputError, match="a file"):
        simulation(outputs=[gx.Ledger(blocked / "ledger.csv")])


# ---- generated: every public name ----------------------------------------------------------------


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Call]]:
    inputs = make_inputs(WORLD.bcast(tmp_path_factory.mktemp("inputs")))
    yield valid_calls(WORLD.bcast(tmp_path_factory.mktemp("outputs")), inputs)
    logging.getLogger("gossamer_fx").handlers.clear()


def taken_or_words(name: str, call: Call) -> str:
    """What is said of a call of a public name; "taken" if nothing."""
    return answer(attrgetter(name)(gx), call)


def answer(function: Callable[..., object], call: Call) -> str:
    """What is said of a call; "taken" if nothing."""
    try:
        function(**call)
    except gx.InputError as error:
        return str(error)
    except Exception as error:
        return f"{type(error).__name__}: {error}\n"
    return "taken"


def test_every_public_name_has_a_valid_call(calls: dict[str, Call]) -> None:
    assert set(calls) | UNCALLED == set(public_names())


@pytest.mark.mpi
def test_every_valid_call_is_taken(calls: dict[str, Call]) -> None:
    """Otherwise a spoiled call could be refused for another reason than its spoiled argument."""
    said = {name: taken_or_words(name, call) for name, call in calls.items()}
    assert {name: words for name, words in said.items() if words != "taken"} == {}


def test_lists_and_arrays_are_taken_where_tuples_are(calls: dict[str, Call]) -> None:
    refused = []
    tried = 0
    for name, call in calls.items():
        for argument, value in call.items():
            if not isinstance(value, tuple | list) or not value:
                continue
            others: list[object] = [list(value) if isinstance(value, tuple) else tuple(value)]
            if all(isinstance(one, int | float) for one in value):
                others.append(np.array(value))
            for other in others:
                tried += 1
                try:
                    made = attrgetter(name)(gx)(**call | {argument: other})
                    is_named_only = isinstance(made, gx.Frame | Obstacle | Actuator | Gas)
                    if isinstance(made, Item) and not is_named_only:
                        gx.Scene(made).compile()
                except Exception as error:
                    refused.append(f"{name}({argument}={other!r}): {type(error).__name__}: {error}")
    assert not refused, "\n".join(refused)
    assert tried > 110


@pytest.mark.mpi
def test_every_argument_of_another_kind_is_one_sentence(calls: dict[str, Call]) -> None:
    """One argument of every public call is replaced by a value that it cannot have."""
    tried = 0
    silent = []
    written = {name: path.stat().st_mtime_ns for name, path in files_of(calls).items()}
    for name, call in calls.items():
        for argument, bad in spoiled(call):
            tried += 1
            words = taken_or_words(name, call | {argument: bad})
            if not is_sentence(words):
                silent.append(f"{name}({argument}={bad!r}): {words}")
    assert not silent, "\n".join(silent)
    assert tried > 1500
    assert written == {name: path.stat().st_mtime_ns for name, path in files_of(calls).items()}


def test_every_argument_of_a_method_of_another_kind_is_one_sentence(tmp_path: Path) -> None:
    tried = 0
    silent = []
    methods = method_calls(make_inputs(tmp_path))
    said = {name: answer(method, call) for name, (method, call) in methods.items()}
    assert {name: words for name, words in said.items() if words != "taken"} == {}
    for name, (method, call) in methods.items():
        for argument, bad in spoiled(call):
            tried += 1
            words = answer(method, call | {argument: bad})
            if not is_sentence(words):
                silent.append(f"{name}({argument}={bad!r}): {words}")
    assert not silent, "\n".join(silent)
    assert tried > 100


def test_every_probe_asks_for_a_run(calls: dict[str, Call]) -> None:
    probes = {name: attrgetter(name)(gx) for name in calls if name.startswith("probes.")}
    assert len(probes) > 20
    for name, probe in probes.items():
        with pytest.raises(
            gx.InputError, match=r"run is 3\.0; give a Simulation or an Equilibrium"
        ):
            probe(**calls[name])(3.0)


def files_of(calls: dict[str, Call]) -> dict[str, Path]:
    """Files in the folder of the outputs, but for the log, which a quiet call may open."""
    folder = calls["Ledger"]["path"].parent
    return {path.name: path for path in folder.iterdir() if path.name != "log.txt"}


# Numbers that may be negative.
OF_ANY_SIGN = {
    "analysis.equilibria": "at",
    "gas.Antoine": "A B C",
    "Case": "halvings",
    "Fixed": "twist",
    "LinearOrthotropic": "nu12",
    "Orthotropic": "nu12",
    "Pressure": "pressure",
    "When": "value",
    "analysis.CrossingTime": "value",
    "analysis.Limit": "low",
    "analysis.TravellingWaves": "forward backward forward_frequency backward_frequency",
    "analysis.convergence": "exact",
    "analysis.imperfect_mesh": "amplitude",
    "analysis.path": "until start",
    "connectors.Crease": "rest_angle",
    "connectors.TabulatedTorsion": "angle moment rest_angle",
    "connectors.TorsionSpring": "rest_angle",
    "constraints.Latch": "angle",
    "control.ReactionWheel": "spin",
    "loads.EdgeMoment": "moment",
    "materials.Fabric": "contraction",
    "loads.StandardAtmosphere": "altitude",
    "loads.UniformFluid": "level",
    "orbit.Drag": "rotation",
    "orbit.Elements": "node perigee anomaly",
    "orbit.ExponentialAtmosphere": "altitude",
    "orbit.Orbit": "ut1_utc",
    "plot.Limits": "low",
    "plot.View": "azimuth elevation",
}
# Numbers that may be zero but not negative.
NOT_NEGATIVE = {
    "At": "time",
    "Chamber": "dead_volume",
    "Damping": "mass_factor stiffness_factor",
    "Elastica": "nu",
    "GeneralizedAlpha": "spectral_radius",
    "Linear": "nu",
    "Miyazaki": "nu residual_stiffness",
    "Orifice": "area",
    "gas.FilmHeat": "coefficient",
    "gas.Inflator": "mass_flow",
    "gas.PorousFilm": "area inertial",
    "gas.Regulator": "area",
    "gas.Valve": "area opens",
    "Orthotropic": "residual_stiffness",
    "Simulation": "halvings",
    "TensionField": "nu residual_stiffness",
    "Tolerances": "relative absolute floor energy scalars constraint",
    "materials.Fabric": "residual_stiffness",
    "materials.MooneyRivlin": "C2",
    "materials.NeoHooke": "residual_stiffness",
    "analysis.Frequency": "number",
    "loads.FluidPressure": "g",
    "loads.UniformFluid": "pressure",
    "analysis.Limit": "high",
    "analysis.Prestress": "nu",
    "analysis.find_form": "change",
    "analysis.StaticCase": "modes",
    "analysis.modes": "above",
    "analysis.harmonic_response": "loss_factor damping_ratio",
    "analysis.random_response": "density loss_factor damping_ratio",
    "analysis.state_space": "loss_factor damping_ratio",
    "connectors.Rope": "damping",
    "connectors.RopeBundle": "damping",
    "connectors.Spring": "length",
    "contact.Plane": "friction",
    "control.AttitudeControl": "stiffness damping period",
    "control.Feedback": "delay",
    "fold.Ikaros": "gap hub_gap out",
    "fold.Miura": "opening lift",
    "fold.Roll": "pitch opening",
    "fold.Star": "gap",
    "fold.TubeZigzag": "opening lift",
    "fold.Zigzag": "opening lift",
    "analysis.equilibria": "seed",
    "gas.Ambient": "pressure",
    "gas.WallHeat": "conductance",
    "materials.ThermalExpansion": "alpha temperature reference",
    "orbit.Accommodation": "normal tangential",
    "orbit.Air": "density",
    "orbit.Elements": "e i",
    "orbit.Optics": "reflectivity specular emissivity lambertian",
    "orbit.SolarHeating": "initial_temperature space_temperature infrared albedo shadow_pixels",
    "orbit.SolarPressure": "shadow_pixels",
    "orbit.Sunlight": "pressure",
    "orbit.ThermalProperties": "absorptivity",
    "plot.Watch": "port",
    "plot.animate": "until",
    "probes.Waves": "number",
    "sections.rectangle": "nu",
    "sections.solid_circle": "nu",
    "sections.tube": "nu",
}


def test_every_number_is_positive_unless_it_is_listed(calls: dict[str, Call]) -> None:
    tried = 0
    wrong = []
    for name, call in calls.items():
        any_sign = OF_ANY_SIGN.get(name, "").split()
        maybe_zero = [*any_sign, *NOT_NEGATIVE.get(name, "").split()]
        for argument, value in call.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            for bad, exceptions in ((type(value)(-1), any_sign), (type(value)(0), maybe_zero)):
                tried += 1
                words = taken_or_words(name, call | {argument: bad})
                # Parts of an assembly name their own argument, which has the same last words.
                is_named = argument.split("_")[0] in words or str(bad) in words
                is_refused = is_sentence(words) and is_named
                if is_refused == (argument in exceptions):
                    wrong.append(f"{name}({argument}={bad}): {words}")
    assert not wrong, "\n".join(wrong)
    assert tried > 570


def test_unknown_and_missing_arguments_are_one_sentence() -> None:
    with pytest.raises(
        gx.InputError, match=r"Tank: the argument 'volume' is missing; .* volume, gas, pressure"
    ):
        gx.Tank(gas=gx.IdealGas(gamma=1.4, R=287.0), pressure=1e5, temperature=300.0)
    with pytest.raises(
        gx.InputError, match=r"Midpoint: there is no .*'step'; its arguments are: dt, rule, tol"
    ):
        gx.Midpoint(dt=0.1, step=2)


# ---- what was written before is kept -------------------------------------------------------------


@pytest.mark.mpi
def test_a_refused_run_destroys_nothing(folder: Path) -> None:
    """Outputs that are asked for before the one that is refused leave the files of an earlier run
    alone."""
    names = ["ledger.csv", "probes.csv"]
    if WORLD.rank == 0:
        for name in names:
            (folder / name).write_text("precious")
    WORLD.barrier()
    outputs = [
        gx.Ledger(folder / "ledger.csv"),
        gx.outputs.Probes(folder / "probes.csv", {"a": lambda run: 1.0}),
        gx.outputs.VTU(folder / "a.pvd", fields=("stres",)),
    ]
    with pytest.raises(gx.InputError, match="stres"):
        simulation(outputs=outputs)
    assert [(folder / name).read_text() for name in names] == ["precious"] * 2


def test_pictures_and_reports_do_not_fall_on_folders(tmp_path: Path) -> None:
    simulation(outputs=[gx.Recording(tmp_path / "run", every=1)]).run(until=2e-3)
    recorded = gx.plot.RunReader(tmp_path / "run")
    target = tmp_path / "folder.gif"
    target.mkdir()
    for draw in (
        lambda: gx.plot.curves(recorded, target),
        lambda: gx.plot.field(recorded, "state", times=[0.0], path=target),
        lambda: gx.plot.strip(recorded, "state", path=target),
        lambda: gx.plot.animate(recorded, "state", path=target),
        lambda: gx.write_report(recorded, target),
    ):
        with pytest.raises(
            gx.InputError, match=r"folder.gif', which is a folder; give the name of a file\."
        ):
            draw()


# ---- the command line ----------------------------------------------------------------------------

GOOD = """
import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
def build(comm, cells=2, until=2e-3):
    law = gx.Linear(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(sheet(comm, cells, cells), law)
    return gx.Case(gx.Scene(film), gx.Midpoint(dt=1e-3), until=until)
"""
SCENES = {
    "no file": (None, [], "no.py"),
    "no text": ("\0", [], "scene.py"),
    "no Python": ("def build(comm:\n", [], "line 1: SyntaxError"),
    "no build": ("x = 1\n", [], "no function build"),
    "build without comm": ("def build():\n    pass\n", [], "'comm'"),
    "build of nothing": ("def build(comm):\n    pass\n", [], "returns NoneType"),
    "import of nothing": ("import gossamer_fy\n", [], "line 1: ModuleNotFoundError"),
    "an error inside": ("def build(comm):\n    return 1 / 0\n", [], "line 2: ZeroDivisionError"),
    "an exit inside": ("raise SystemExit\n", [], "line 1: SystemExit"),
    "a scene that cannot be": (GOOD.replace("1400.0", "-1.0"), [], "density"),
    "an option that is unknown": (GOOD, ["cell=3"], "takes no cell"),
    "an option without value": (GOOD, ["cells"], "'cells'"),
    "an option of another kind": (GOOD, ["until=long"], "until"),
    "a value that is missing": (GOOD.replace("cells=2", "cells"), [], "cells"),
    "nothing to restart from": (GOOD, ["--restart"], "checkpoint"),
    "a checkpoint that is nowhere": (GOOD, ["--restart", "saved"], "no checkpoint in 'saved'"),
    "no ranks": (GOOD, ["--ranks", "0"], "'0'"),
    "unknown flag": (GOOD, ["--fast"], "--fast"),
    "a log that cannot be": (GOOD, ["--log", "scene.py/log.txt"], "log.txt"),
}


def exit_code(words: list[str]) -> object:
    """The exit code of the command, whether it returns it or leaves with it."""
    try:
        return main(words)
    except SystemExit as leave:
        return leave.code


@pytest.mark.parametrize("case", SCENES)
def test_run_of_a_bad_scene_is_one_sentence(case: str, tmp_path: Path, monkeypatch, capsys) -> None:
    text, words, culprit = SCENES[case]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    if text is not None:
        Path("scene.py").write_text(text)
    code = exit_code(["run", "scene.py" if text is not None else "no.py", "-o", "run", *words])
    out, err = capsys.readouterr()
    assert code == 2 and not out
    assert is_line_of_command(err) and culprit in err


@pytest.mark.parametrize(
    "end", [gx.run.Interrupted(15), gx.OutputFailure("full"), gx.NoEquilibrium("none")]
)
def test_what_is_no_error_of_a_scene_file_is_raised_as_it_is(end: BaseException, capsys) -> None:
    def stop() -> None:
        raise end

    with pytest.raises(type(end)):
        guarded(MPI.COMM_SELF, Path("scene.py"), False, stop)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    "words, culprit",
    [
        (["plot", "run", "--field", "stres"], "stres"),
        (["plot", "run", "--time", "9"], "t = 9 s"),
        (["plot", "run", "--time", "soon"], "soon"),
        (["plot", "run", "--strip", "-3"], "-3"),
        (["plot", "run", "--strip", "3", "--curves"], "one of them"),
        (["plot", "run", "--curves", "--range", "0", "1"], "draws no shapes"),
        (["plot", "run", "--output", "a.png"], "--output"),
        (["plot", "run", "--animate", "avi"], "avi"),
        (["plot", "nowhere"], "nowhere"),
        (["report", "nowhere"], "nowhere"),
        (["report", "run", "--output", "scene.py/report.html"], "report.html"),
        (["plot"], "run"),
        (["show", "run"], "show"),
    ],
)
def test_looking_at_what_is_not_there_is_one_sentence(
    words, culprit, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.py").write_text(GOOD)
    assert main(["run", "scene.py", "-o", "run", "--quiet"]) == 0
    capsys.readouterr()
    code = exit_code(words)
    _, err = capsys.readouterr()
    assert code in (1, 2)
    assert is_line_of_command(err) and culprit in err


SPHERE = """
import gossamer_fx as gx
from gossamer_fx.meshes.sphere import sphere

def build(comm):
    law = gx.Miyazaki(1e9, 0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sphere(comm, 1.0, 10), law)
    return gx.Case(gx.Scene(film, gx.Pressure(film, 1.0)), gx.Midpoint(dt=1e-3), until=2e-3)
"""


def test_a_dry_run_reads_the_checkpoint(tmp_path: Path, monkeypatch, capsys) -> None:
    """Without one, and with another scene, it said that all was well."""
    monkeypatch.chdir(tmp_path)
    Path("scene.py").write_text(GOOD)
    words = ["run", "scene.py", "--restart", "--dry-run"]
    assert main(words) == 2
    assert "There is no checkpoint in 'out/scene/checkpoints'" in capsys.readouterr().err
    assert main(["run", "scene.py", "--quiet"]) == 0
    assert main(words) == 0
    assert "about 0 steps" in capsys.readouterr().out
    Path("scene.py").write_text(GOOD.replace("density=1400.0", "density=1000.0"))
    assert main(words) == 2
    assert "density" in capsys.readouterr().err


def test_a_dry_run_shows_the_side_of_the_normals(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sphere.py").write_text(SPHERE)
    assert main(["run", "sphere.py", "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"'film' encloses [34]\.\d+ m³, and its normals point outwards\n", said)
    Path("scene.py").write_text(GOOD)
    assert main(["run", "scene.py", "--dry-run"]) == 0
    # A sheet has no inside.
    said = capsys.readouterr().out
    assert "normals" not in said and "intersect" not in said


def test_a_dry_run_warns_of_films_that_intersect(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    second = """
    turned = lambda X: np.vstack([0.4321 - X[0], 0 * X[1], X[0] - 0.4])
    upright = gx.Membrane(sheet(comm, 2, 2), law, displacement=turned, name="upright")
    return gx.Case(gx.Scene(film, upright), """
    scene = SPHERE.replace("    return gx.Case(gx.Scene(film, gx.Pressure(film, 1.0)), ", second)
    scene = scene.replace(
        "import gossamer_fx as gx", "import gossamer_fx as gx\nimport numpy as np"
    )
    scene = scene.replace("meshes.sphere import sphere", "meshes.sheet import sheet")
    Path("crossed.py").write_text(scene.replace("sphere(comm, 1.0, 10)", "sheet(comm, 2, 2)"))
    assert main(["run", "crossed.py", "--dry-run"]) == 0
    assert re.search(r"warning: \d+ edges of films intersect films", capsys.readouterr().out)


@pytest.mark.mpi
def test_bodies_on_other_ranks_are_refused(comm) -> None:
    """A hub without `comm` is on all ranks, its film on one."""
    sail = film(comm=MPI.COMM_SELF, name="sail")
    scene = gx.Scene(sail, gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="hub", comm=comm))
    if comm.size == 1:
        # The same rank in both.
        assert scene.compile().unknowns.numbering.size == 27 + 18
        return
    with pytest.raises(gx.InputError, match=r"'hub' is on 2 ranks and 'sail' on 1.*same comm"):
        scene.compile()


def test_ctrl_c_names_the_command_that_goes_on(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    stop = "events=[gx.At(1e-3, lambda run: signal.raise_signal(signal.SIGINT))], until=until)"
    scene = GOOD.replace("until=until)", stop).replace("import goss", "import signal\nimport goss")
    Path("scene.py").write_text(scene)
    words = ["run", "scene.py", "-o", "a run", "--quiet", "cells=1"]
    assert exit_code([*words, "--overwrite"]) == 130
    go_on = "gossamer: go on with: ./gossamer run scene.py -o 'a run' --quiet cells=1 --restart\n"
    assert capsys.readouterr().err.endswith(go_on)
    # As the launcher hands it on.
    assert gx.run.Interrupted(signal.SIGUSR2).signal is signal.SIGINT


def test_a_run_is_kept_and_can_go_on(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.py").write_text(GOOD)
    assert main(["run", "scene.py", "--dry-run"]) == 0
    assert "Membrane, 8 cells" in capsys.readouterr().out and not Path("out").exists()
    assert main(["run", "scene.py", "--quiet"]) == 0
    ledger = Path("out/scene/ledger.csv").read_text()
    assert main(["run", "scene.py", "--quiet"]) == 2
    assert "holds a run already" in capsys.readouterr().err
    assert Path("out/scene/ledger.csv").read_text() == ledger
    assert main(["run", "scene.py", "--quiet", "--restart", "until=4e-3"]) == 0
    assert Path("out/scene/ledger.csv").read_text().startswith(ledger)
    assert main(["run", "scene.py", "--quiet", "--overwrite"]) == 0
    assert Path("out/scene/ledger.csv").read_text() == ledger
    assert gx.plot.RunReader("out/scene").times == pytest.approx([0.0, 1e-3, 2e-3])

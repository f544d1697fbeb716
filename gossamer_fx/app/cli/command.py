"""The commands run, watch, sweep, plot, report, export, demo, validate and doctor.

What is wrong is told in one sentence, with code 2 for input and 1 for the rest.

Heavy modules are loaded when the words on the command line are known to be right.
"""

from __future__ import annotations

import argparse
import math
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from gossamer_fx.core.checks.shown import shown
from gossamer_fx.version import VERSION

if TYPE_CHECKING:
    from types import ModuleType

    from mpi4py import MPI

    from gossamer_fx.analysis.cases.static_case import StaticCase
    from gossamer_fx.mechanics.bodies.membrane import Membrane
    from gossamer_fx.records.outputs.output import Output
    from gossamer_fx.records.run.case import Case
    from gossamer_fx.solve.view import StateView

# Environment variables by which mpirun or a batch system shows that it started this process.
# Slurm sets SLURM_PROCID in the script of a job, too, which is not a rank.
_LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK", "SLURM_STEP_ID")


# Digits of a whole number on the command line.
_MAX_DIGITS = 18


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence."""

    def error(self, message: str) -> NoReturn:
        """Print the message with the name of the command, and exit with the code 2."""
        self.exit(2, f"gossamer: {shown(message)}; see {self.prog} --help.\n")


def main(words: Sequence[str]) -> int:
    """Run one command of `gossamer`, in this process or on the ranks that it asks for.

    Args:
        words: name of the command and its arguments, without the name of the program.

    Returns:
        Exit code: 0, 2 for wrong input, 1 for another failure.  Errors of the package are printed
        in one sentence.

    Raises:
        SystemExit: after `--help`, or with the code 2 for words that it does not know.
        Exception: with `--debug` every error as it is; else those that are not of the package.
    """
    from gossamer_fx.core.checks.ctrl_c import usual_ctrl_c

    if words[:1] in (["demo"], ["validate"]):
        usual_ctrl_c()
    if words[:1] == ["demo"]:  # its options are its own
        from gossamer_fx.app.cli.demo import main as run_demo

        return run_demo(words[1:])
    if words[:1] == ["validate"]:  # so are its options
        from gossamer_fx.app.cli.demo import validate

        return validate(words[1:])
    complete = _with_values(words)
    parser = _parser()
    wanted, others = parser.parse_known_args(complete)
    wanted.others = others
    if others and wanted.name != "watch":  # what it does not know is for the run that it starts
        parser.error(f"unrecognized arguments: {' '.join(others)}")
    wanted.words = complete
    if wanted.name == "doctor":  # it tells of missing packages, and imports none of them here
        from gossamer_fx.app.cli.doctor import main as examine

        return examine()
    # A process that mpirun has started is one of its ranks, and starts no others.
    if not any(name in os.environ for name in _LAUNCHED):
        if getattr(wanted, "jobs", 1) > 1:
            from gossamer_fx.app.cli.launch import OWN_COMMAND, launch_alike

            return launch_alike(wanted.jobs, [*OWN_COMMAND, *words, "--jobs", "1"])
        if getattr(wanted, "ranks", 1) > 1:
            from gossamer_fx.app.cli.launch import OWN_COMMAND, launch

            return launch(wanted.ranks, [*OWN_COMMAND, *words])
    if wanted.name == "run":
        # Imported here, as other commands do not need it.
        from gossamer_fx.core.checks.ending import Listener

        # From now on: to load the libraries takes seconds, to make and compile a scene minutes.
        with Listener((signal.SIGTERM, signal.SIGUSR1)):
            return _on_this_rank(wanted)
    return _on_this_rank(wanted)


def _on_this_rank(wanted: argparse.Namespace) -> int:
    """Run a command in this process; returns its exit code, see `main`."""
    from gossamer_fx.core.checks.ctrl_c import STOPPED, raise_at_ctrl_c
    from gossamer_fx.core.checks.ending import abort_on_lone_error, lacks_room, no_room
    from gossamer_fx.core.checks.memory_limit import speak_if_killed

    speak_if_killed()
    try:
        from mpi4py import MPI

        from gossamer_fx.app.cli.user_files import end_program
        from gossamer_fx.core.checks.errors import (
            InputError,
            NoEquilibrium,
            OutputFailure,
            StepFailure,
            check,
        )
    except (ImportError, MemoryError) as error:
        words = (
            f"mpi4py cannot be imported ({error}); use a Python with dolfinx, petsc4py, "
            "mpi4py and gmsh. gossamer doctor shows what this one has."
        )
        if lacks_room(error):
            words = no_room(error)
        print(f"gossamer: {words}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"gossamer: {error}", file=sys.stderr)
        return 1

    comm = MPI.COMM_WORLD
    if _ranks_are_alone(comm):
        return 1
    try:
        raise_at_ctrl_c()
        # An error on one rank alone would leave the others waiting.
        with abort_on_lone_error(comm):
            ranks = getattr(wanted, "ranks", 1)
            check(
                ranks in (1, comm.size),
                f"--ranks is {ranks}, but mpirun or srun has started {comm.size}; leave --ranks "
                "out.",
            )
            code: int | None = wanted.command(wanted, comm)
    except (InputError, StepFailure, NoEquilibrium, OutputFailure) as error:
        if wanted.debug:
            raise
        if comm.rank == 0:
            print(f"gossamer: {error}", file=sys.stderr, flush=True)
        # Scripts can tell wrong input from a computation that failed.
        return 2 if isinstance(error, InputError) else 1
    # Ctrl-C before or after the steps of a run, which end by themselves.
    except KeyboardInterrupt:
        end_program(comm, STOPPED, 130)
    # These may happen on one rank only, so that the program is ended on all of them.
    except (MemoryError, OSError, ImportError) as error:
        if wanted.debug:
            raise
        if lacks_room(error):
            end_program(comm, no_room(error))
        if isinstance(error, ImportError):
            raise
        end_program(
            comm,
            f"{type(error).__name__}: {error}; look for memory and disk space, or for the file "
            "that it names.",
        )
    return code or 0


def _ranks_are_alone(comm: MPI.Intracomm) -> bool:
    """Whether mpirun has started several ranks of which each sees only itself; prints why.

    That happens where mpirun belongs to another MPI than mpi4py.  It is found by the environment
    variables of Open MPI and MPICH."""
    from mpi4py import MPI

    # The first is set by Open MPI, the second by MPICH.
    started = os.environ.get("OMPI_COMM_WORLD_SIZE") or os.environ.get("PMI_SIZE") or "1"
    if started == "1" or comm.size > 1:
        return False
    rank = os.environ.get("OMPI_COMM_WORLD_RANK") or os.environ.get("PMI_RANK")
    # Each process is rank 0 of an MPI that has one rank; the environment has the true number.
    if rank in ("0", None):
        library, version = MPI.get_vendor()
        numbers = ".".join(map(str, version))
        print(
            f"gossamer: mpirun has started {started} ranks that do not see each other: it belongs "
            f"to another MPI than mpi4py, which has {library} {numbers}; use the mpirun of that, "
            "or unset OMPI_COMM_WORLD_SIZE and PMI_SIZE if there is none.",
            file=sys.stderr,
            flush=True,
        )
    return True


def script() -> int:
    """The command `gossamer` of an installed package."""
    from gossamer_fx.core.checks.ctrl_c import end_at_ctrl_c

    end_at_ctrl_c()
    return main(sys.argv[1:])


def _with_values(words: Sequence[str]) -> list[str]:
    """The words with an explicit value of `--restart`, `newest` where none is given.

    None is given where what follows `--restart` is the scene, an argument of it, or an option."""
    rest = list(words)
    given: list[str] = []
    # argparse would take the scene for the optional value of --restart.
    while rest:
        word = rest.pop(0)
        if word == "--restart":
            named = bool(rest) and not (
                rest[0].startswith("-") or rest[0].endswith(".py") or "=" in rest[0]
            )
            word = f"--restart={rest.pop(0) if named else 'newest'}"
        given.append(word)
    return given


def _parser() -> argparse.ArgumentParser:
    """The parser of the command line of `gossamer`, with all commands and their options.

    Commands that read or make runs store the function that runs them as `command`, which returns an
    exit code or None; `main` itself runs demo, validate and doctor, and their entries here serve
    `--help`.  The parser ends the program with the code 2, and one sentence on standard error, for
    words that it does not know.
    """
    parser = _Parser(prog="gossamer", description="Run a scene, and look at what it did.")
    parser.add_argument("--version", action="version", version=f"gossamer_fx {VERSION}")
    commands = parser.add_subparsers(
        required=True,
        dest="name",
        metavar="run|watch|sweep|plot|report|export|demo|validate|doctor",
        parser_class=_Parser,
    )

    run = commands.add_parser("run", help="run a scene file")
    run.add_argument(
        "scene",
        type=Path,
        help="Python file with a function build(comm, ...) that returns a gx.Case, or a "
        "gx.analysis.StaticCase",
    )
    run.add_argument("options", nargs="*", metavar="NAME=VALUE", help="further arguments of build")
    run.add_argument(
        "-o", "--output", type=Path, help="folder of the run; default out/NAME of the scene file"
    )
    run.add_argument("-n", "--ranks", type=_positive, default=1, help="MPI ranks")
    # Its value is optional, see `_with_values`.
    words = "go on from the newest checkpoint in the folder, or from that of a step, or in a folder"
    run.add_argument("--restart", metavar="[STEP|FOLDER]", help=words)
    run.add_argument(
        "--changed",
        default="",
        metavar="PART,...",
        help="whose parameters differ from the checkpoint's",
    )
    run.add_argument("--overwrite", action="store_true", help="replace a run that the folder holds")
    run.add_argument(
        "--dry-run",
        action="store_true",
        help="compile and check the scene, print it, compute nothing",
    )
    run.add_argument("--quiet", action="store_true", help="only warnings on the terminal")
    run.add_argument("--log", type=Path, help="file that all messages are appended to")
    run.add_argument(
        "--checkpoint",
        type=_positive,
        default=100,
        metavar="STEPS",
        help="steps between checkpoints",
    )
    run.add_argument(
        "--no-progress-after",
        type=_seconds,
        metavar="SECONDS",
        help="end the run if no step is completed for this time; default: wait for ever",
    )
    run.set_defaults(command=_run)

    watch = commands.add_parser(
        "watch", help="a run in the browser, also while it computes; further words are those of run"
    )
    watch.add_argument(
        "what", type=Path, metavar="SCENE|RUN", help="scene file to run, or folder of a run"
    )
    watch.add_argument("-o", "--output", type=Path, help="folder of the run of a scene, as of run")
    watch.add_argument("--port", type=_positive, default=0, help="default: any that is free")
    watch.set_defaults(command=_watch, debug=False)

    sweep = commands.add_parser("sweep", help="many runs of a scene, or those of a design")
    sweep.add_argument(
        "design",
        type=Path,
        metavar="FILE",
        help="a scene file, with --over; or a file with a Factorial named SWEEP",
    )
    sweep.add_argument(
        "options",
        nargs="*",
        metavar="NAME=VALUE",
        help="further arguments of build, the same in all runs, as of run; before --over",
    )
    sweep.add_argument(
        "--over",
        nargs="+",
        metavar="NAME=VALUE,VALUE",
        help="arguments of build and their values; all combinations are run",
    )
    sweep.add_argument(
        "--list",
        action="store_true",
        help="with --over: the first values belong together, the second ones, and so on",
    )
    sweep.add_argument(
        "-o", "--output", type=Path, help="folder of the runs; default out/NAME of the file"
    )
    sweep.add_argument(
        "-j", "--jobs", type=_positive, default=1, help="processes that share the runs"
    )
    sweep.add_argument("-n", "--ranks", type=_positive, default=1, help="MPI ranks of each process")
    sweep.set_defaults(command=_sweep)

    plot = commands.add_parser(
        "plot", help="pictures of a run: by default its films at six times, and curves"
    )
    plot.add_argument("run", type=Path, help="folder of a run")
    plot.add_argument(
        "-f",
        "--field",
        help="state, stress1, pressure, displacement and its components displacement_x, _y, _z and "
        "_normal, velocity, ...",
    )
    plot.add_argument("-t", "--time", type=float, nargs="+", metavar="T", help="at these times [s]")
    plot.add_argument(
        "-s", "--strip", type=_positive, metavar="N", help="at N times, evenly spread"
    )
    plot.add_argument("-a", "--animate", action="store_true", help="an animation, a GIF")
    plot.add_argument(
        "-c", "--curves", action="store_true", help="ledger, gas and probes over the time"
    )
    plot.add_argument(
        "--range",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="ends of the colours, in SI units; values beyond are marked",
    )
    plot.add_argument("--part", default="", metavar="NAME", help="colour one film or line only")
    plot.add_argument(
        "--each-time", action="store_true", help="each picture has its own ends of the colours"
    )
    plot.add_argument("--log", action="store_true", help="colours follow the logarithm")
    plot.add_argument(
        "--azimuth-degrees", type=float, metavar="ANGLE", help="of the camera; 0 looks along y"
    )
    plot.add_argument(
        "--elevation-degrees", type=float, metavar="ANGLE", help="of the camera above the horizon"
    )
    plot.add_argument("--follow", action="store_true", help="the camera moves with the shapes")
    plot.add_argument(
        "--zoom", action="store_true", help="each picture as large as its frame allows"
    )
    plot.add_argument(
        "--flat", action="store_true", help="numbers have the colours of the bar, without light"
    )
    plot.add_argument("--edges", action="store_true", help="the edges of the mesh on films")
    plot.add_argument("-o", "--output", type=Path, help="file; default: in the folder of the run")
    plot.set_defaults(command=_plot)

    report = commands.add_parser(
        "report", help="one HTML page about a run that needs no other file"
    )
    report.add_argument("run", type=Path, help="folder of a run")
    report.add_argument(
        "-o", "--output", type=Path, help="file; default report.html in the folder of the run"
    )
    report.set_defaults(command=_report)
    export = commands.add_parser(
        "export", help="the scene of a run in one PVD file, for ParaView, VisIt and pyvista"
    )
    export.add_argument("run", type=Path, help="folder of a run")
    export.add_argument(
        "-o", "--output", type=Path, help="folder; default vtu in the folder of the run"
    )
    export.add_argument(
        "--every",
        type=_positive,
        metavar="N",
        help="one state of N, and the last one; default: all, if there are at most 20 000",
    )
    export.set_defaults(command=_export)
    # These execute files of users or read runs, whose errors may need a traceback.
    for command in (run, sweep, plot, report, export):
        command.add_argument("--debug", action="store_true", help="show where an error comes from")

    demo = commands.add_parser("demo", help="run a demo of a clone, folded_tube by default")
    demo.add_argument("demo", nargs="?", metavar="NAME", help="file in demos/*, without .py")
    demo.add_argument("arguments", nargs="*", help="what that demo takes")
    validate = commands.add_parser(
        "validate", help="compare predictions with measurements of a case of a clone, or of a file"
    )
    validate.add_argument("case", metavar="NAME", help="case, TOML file, or all")
    validate.add_argument(
        "arguments", nargs="*", help="--quick, --only, --set, --sensitivity, --store, --out"
    )
    commands.add_parser("doctor", help="show the versions of everything, and check that it works")
    return parser


def _positive(word: str) -> int:
    """A positive whole number from a word of the command line."""
    if not word.isdecimal() or len(word) > _MAX_DIGITS or int(word) < 1:
        raise argparse.ArgumentTypeError(f"'{word}' is not a positive number")
    return int(word)


def _seconds(word: str) -> float:
    """A positive finite time [s] from a word of the command line."""
    try:
        seconds = float(word)
    except ValueError:
        seconds = 0.0
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"'{word}' is not a positive number of seconds")
    return seconds


# ---- run -----------------------------------------------------------------------------------------


def _run(wanted: argparse.Namespace, comm: MPI.Intracomm) -> None:
    """Run a scene file until its end time: `gossamer run`.  Collective.

    It writes the folder of the run, with checkpoints; with `--dry-run` it only prints what the
    scene contains.

    Raises:
        InputError: the folder holds a run already, or the scene file is wrong.
        StepFailure: a time step did not converge.
        OutputFailure: a file could not be written.
    """
    from gossamer_fx.core.checks.ending import Interrupted
    from gossamer_fx.core.checks.errors import check
    from gossamer_fx.records.outputs.progress import Progress
    from gossamer_fx.records.run.case import Case
    from gossamer_fx.records.run.checkpoint import Checkpoints
    from gossamer_fx.records.run.log import log_to

    folder: Path = wanted.output or Path("out") / wanted.scene.stem
    # An existing run is never overwritten unasked.
    free = (
        wanted.dry_run or wanted.restart or wanted.overwrite or not (folder / "run.json").exists()
    )
    check(
        # Rank 0 decides, as other ranks may see the folder later.
        comm.bcast(free),
        f"'{folder}' holds a run already; give another folder with --output, go on with --restart, "
        "or replace it with --overwrite.",
    )
    saves = folder / "checkpoints"
    restart: Path | None = None
    if wanted.restart == "newest":
        restart = saves
    elif wanted.restart:
        restart = (
            saves / f"step-{int(wanted.restart):08d}"
            if wanted.restart.isdecimal() and len(wanted.restart) <= _MAX_DIGITS
            else Path(wanted.restart)
        )
    changes = [name for name in wanted.changed.split(",") if name]
    watchers: list[Output] = []
    if wanted.no_progress_after:
        from gossamer_fx.app.cli.no_progress import NoProgress

        watchers.append(NoProgress(comm, wanted.no_progress_after, wanted.scene))
    case, parameters = _case(wanted, comm)
    if not isinstance(case, Case):
        _compute(wanted, case, folder, watchers, parameters)
        return
    if wanted.dry_run:
        _show(case, comm, restart, changes)
        return
    log_to(comm, wanted.log, quiet=wanted.quiet)
    recording = case.recording(folder, overwrite=wanted.overwrite, parameters=parameters)
    outputs: list[Output] = [recording]
    outputs += watchers
    if not wanted.quiet:
        outputs.append(Progress())
    checkpoints = Checkpoints(saves, every=wanted.checkpoint, overwrite=wanted.overwrite)
    run = case.simulation(outputs, checkpoints, restart, changes)
    try:
        run.run(until=case.until)
    except Interrupted:
        if comm.rank == 0:
            given = [w for w in wanted.words if not w.startswith(("--restart", "--overwrite"))]
            command = shlex.join(["./gossamer", *given, "--restart"])
            print(f"gossamer: go on with: {command}", file=sys.stderr, flush=True)
        raise
    if comm.rank == 0 and not wanted.quiet:
        name = shown(str(folder))
        print(f"written to {name}; look at it with: ./gossamer report {name}")


def _compute(
    wanted: argparse.Namespace,
    case: StaticCase,
    folder: Path,
    watchers: Sequence[Output],
    parameters: Mapping[str, object],
) -> None:
    """Find and record the equilibria of a static case: `gossamer run`.  Collective.

    Raises:
        InputError: options of runs that go on in time, or what is wrong with the scene.
        NoEquilibrium: the equilibria before are written.
        OutputFailure: a file could not be written.
    """
    from gossamer_fx.analysis.cases.results import shown_names
    from gossamer_fx.core.checks.errors import check
    from gossamer_fx.records.fields.units import without_round_off
    from gossamer_fx.records.run.log import log_to

    comm = case.equilibrium.comm
    check(
        not (wanted.restart or wanted.changed),
        f"build in '{wanted.scene}' returns a StaticCase, which is always computed from the start; "
        "leave --restart and --changed out.",
    )
    if wanted.dry_run:
        _describe(case.equilibrium, comm, "nothing was computed")
        return
    log_to(comm, wanted.log, quiet=wanted.quiet)
    numbers = case.compute(folder, watchers, overwrite=wanted.overwrite, parameters=parameters)
    if comm.rank == 0 and not wanted.quiet:
        result = case.equilibrium.result
        if result is not None:
            print(result.summary())
        values = without_round_off(numbers)
        for name in shown_names([numbers]):
            print(f"  {name}: {float(values[name]):.6g}")
        name = shown(str(folder))
        print(f"written to {name}; look at it with: ./gossamer report {name}")


def _show(case: Case, comm: MPI.Intracomm, restart: Path | None, changes: list[str]) -> None:
    """Compile a case, and print what it contains and what is strange about it, at its start or at
    the checkpoint from which it would go on.  Collective.

    Nothing is computed; rank 0 prints.

    Raises:
        InputError: what is wrong with the scene or the checkpoint.
    """
    run = case.simulation(restart=restart, changes=changes)
    steps = max(case.until - run.time, 0.0) / case.stepper.dt
    _describe(
        run,
        comm,
        f"about {steps:.6g} steps of {case.stepper.dt:.6g} s to t = {case.until:.6g} s; nothing "
        "was computed",
    )


def _describe(view: StateView, comm: MPI.Intracomm, words: str) -> None:
    """Print what a scene contains, the words, and what is strange about the scene.  Collective."""
    from gossamer_fx.mechanics.bodies.membrane import Membrane
    from gossamer_fx.records.outputs.description import describe, lines
    from gossamer_fx.records.probes.contact import Crossings
    from gossamer_fx.solve.scene.validation import warnings

    about = describe(view)
    strange = list(warnings(view.scene.items))
    films = [body for body in view.system.unknowns.bodies if isinstance(body, Membrane)]
    # This search takes too long for every run; a dry run has the time.
    crossings = Crossings(*films)(view) if films else 0
    if crossings:
        strange.append(f"{crossings:.0f} edges of films intersect films at the start.")
    sides = list(_sides(films))
    if comm.rank == 0:
        print("\n".join(lines(about)))
        for side in sides:
            print(side)
        print(words)
        for one in strange:
            print(f"warning: {one}")


def _sides(films: Iterable[Membrane]) -> Iterator[str]:
    """Sentences about the side of the normals of films that enclose a volume [m³].  Collective."""
    from gossamer_fx.core.mesh.enclosed_volume import enclosed_by

    for film in films:
        enclosed = enclosed_by(film.mesh.domain, film.mesh.edges)
        if enclosed.has_inside:
            side = "outwards"
            if enclosed.volume < 0:
                side = "inwards"
            yield (
                f"'{film.name}' encloses {abs(enclosed.volume):.6g} m³, and its normals point "
                f"{side}"
            )


def _case(
    wanted: argparse.Namespace, comm: MPI.Intracomm
) -> tuple[Case | StaticCase, dict[str, object]]:
    """The `Case` or `StaticCase` that the function `build` of a scene file returns, and all
    arguments of the function by name.  Collective.

    Raises:
        InputError: the file does not exist, it has no `build`, or `build` has other arguments or
            another result.
        SystemExit: the file itself raises an error, which is printed.
    """
    import inspect

    from gossamer_fx.app.cli.user_files import build_of, check_arguments_of, guarded, load, option
    from gossamer_fx.core.checks.errors import InputError, check
    from gossamer_fx.core.checks.lookups import check_file
    from gossamer_fx.records.run.case import Case, all_arguments

    path: Path = wanted.scene
    check_file(path, "scene file", "give a Python file with a function build(comm)")
    given = [option(word) for word in wanted.options]
    options = dict(given)
    for name in options:
        count = sum(name == other for other, _ in given)
        check(count == 1, f"{name} is given {count} times; give it once.")
    module = guarded(comm, path, wanted.debug, lambda: load(path))
    build = build_of(path, module)
    check_arguments_of(build, path, given)
    parameters = inspect.signature(build).parameters
    # The first parameter is the communicator, which the command gives.
    missing = [
        name
        for name, parameter in list(parameters.items())[1:]
        if name not in options
        and parameter.default is parameter.empty
        and parameter.kind is parameter.POSITIONAL_OR_KEYWORD
    ]
    check(
        not missing, f"build in '{path}' needs a value for {', '.join(missing)}; give NAME=VALUE."
    )
    case = guarded(comm, path, wanted.debug, lambda: build(comm, **options))
    used = all_arguments(build, options)
    if isinstance(case, Case):
        return case, used
    from gossamer_fx.analysis.cases.static_case import StaticCase

    if not isinstance(case, StaticCase):
        raise InputError(
            f"build in '{path}' returns {type(case).__name__}; let it return a gossamer_fx.Case, "
            "or a gossamer_fx.analysis.StaticCase of an equilibrium."
        )
    return case, used


def _sweep(wanted: argparse.Namespace, comm: MPI.Intracomm) -> None:
    """Compute the runs of a sweep that its folder lacks, and print what follows from all.
    Collective.

    The sweep is over arguments of a scene file (`--over`), or the object SWEEP of a design file.

    Raises:
        InputError: the file does not exist or has no SWEEP, options contradict each other, or the
            folder holds runs of another scene.
    """
    from gossamer_fx.app.cli.user_files import guarded, load
    from gossamer_fx.app.sweep.factorial import Factorial, run_factorial
    from gossamer_fx.core.checks.errors import InputError, check
    from gossamer_fx.core.checks.lookups import check_file

    path: Path = wanted.design
    check_file(path, "file", "give a scene file with --over, or a file with a SWEEP")
    check(
        not wanted.list or bool(wanted.over),
        "--list says how the values of --over belong together; give --over NAME=VALUE,VALUE.",
    )
    check(
        not wanted.options or bool(wanted.over),
        "NAME=VALUE gives arguments that are not varied; vary others by --over NAME=VALUE,VALUE.",
    )
    folder: Path = wanted.output or Path("out") / path.stem
    module = guarded(comm, path, wanted.debug, lambda: load(path))
    if wanted.over:
        from gossamer_fx.app.cli.scene_sweep import check_same_scene

        design: object = _scene_sweep(wanted, module)
        folder = wanted.output or Path("out") / f"{path.stem}_sweep"
        check_same_scene(comm, path, folder)
    else:
        design = getattr(module, "SWEEP", None)
    if not isinstance(design, Factorial):
        raise InputError(
            f"'{path}' has no SWEEP; let it be a gx.sweep.Factorial, or vary the arguments of a "
            "scene file with --over."
        )
    sweep = design
    text = guarded(comm, path, wanted.debug, lambda: run_factorial(sweep, comm, folder))
    if comm.rank == 0:
        print(f"{text}\nwritten to {folder}")


def _scene_sweep(wanted: argparse.Namespace, module: ModuleType) -> object:
    """The sweep (a `Factorial`) over the arguments of the function `build` of a scene file.

    Raises:
        InputError: there is no `build`, or it has no such arguments, or a word has another form.
    """
    from gossamer_fx.app.cli.scene_sweep import scene_sweep
    from gossamer_fx.app.cli.user_files import build_of

    build = build_of(wanted.design, module)

    def progress(line: str) -> None:
        print(f"gossamer: {line}", file=sys.stderr, flush=True)

    return scene_sweep(
        build,
        wanted.design,
        wanted.over,
        fixed=wanted.options,
        listed=wanted.list,
        progress=progress,
    )


# ---- plot and report -----------------------------------------------------------------------------


def _plot(wanted: argparse.Namespace, comm: MPI.Intracomm) -> None:
    """Write the pictures of a run that the options ask for, and print their paths.

    Without an option for a picture it writes a strip of six times and the curves.

    Raises:
        InputError: several kinds of pictures, or `--output` without one, or no run in the folder,
            or a field or time that it has not.
    """
    from gossamer_fx.core.checks.errors import check
    from gossamer_fx.records.plot import plot as pictures
    from gossamer_fx.records.plot.camera import View
    from gossamer_fx.records.plot.colours import Limits, default_field
    from gossamer_fx.records.plot.run_reader import RunReader

    folder: Path = wanted.run
    run = RunReader(folder)
    pictures_of = ("time", "strip", "animate", "curves")
    chosen = [option for option in pictures_of if getattr(wanted, option)]
    check(
        len(chosen) <= 1,
        f"--{' and --'.join(chosen)} are several pictures; give one of them at a time.",
    )
    check(
        bool(chosen) or wanted.output is None,
        "--output names one file; say which picture with --strip, --time, ...",
    )
    azimuth, elevation = (
        None if a is None else math.radians(a)
        for a in (wanted.azimuth_degrees, wanted.elevation_degrees)
    )
    view = View(
        azimuth,
        elevation,
        follow=wanted.follow or None,
        zoom=wanted.zoom,
        flat=wanted.flat,
        edges=wanted.edges,
    )
    low, high = wanted.range or (None, None)
    limits = Limits(low, high, wanted.part, wanted.each_time, wanted.log)
    field: str = wanted.field or ""
    check(
        chosen != ["curves"] or (not field and limits == Limits() and view == View()),
        "--curves draws no shapes; leave the options of colours and of the camera out.",
    )
    # Curves have no field.
    if not field and chosen != ["curves"]:
        field = default_field(run)
    output: Path | None = wanted.output
    if not chosen or wanted.strip:
        _write_and_print(
            output or folder / f"{field}.png",
            lambda path: pictures.strip(
                run, field, path=path, count=wanted.strip or 6, view=view, limits=limits
            ),
        )
    if wanted.time:
        _write_and_print(
            output or folder / f"{field}_at.png",
            lambda path: pictures.field(
                run, field, times=wanted.time, path=path, view=view, limits=limits
            ),
        )
    if wanted.animate:
        _write_and_print(
            output or folder / f"{field}.gif",
            lambda path: pictures.animate(run, field, path=path, view=view, limits=limits),
        )
    # Equilibria and modes have no curves over time.
    if wanted.curves or (not chosen and run.kind == "run"):
        _write_and_print(output or folder / "curves.png", lambda path: pictures.curves(run, path))


def _watch(wanted: argparse.Namespace, comm: MPI.Intracomm) -> int:
    """Show a run in the browser until Ctrl-C; returns the exit code."""
    from gossamer_fx.app.cli.watch import watch

    return watch(wanted.what, wanted.output, wanted.port, wanted.others)


def _report(wanted: argparse.Namespace, comm: MPI.Intracomm) -> None:
    """Write the HTML page of a run, and print its path."""
    from gossamer_fx.records.plot.report import write_report
    from gossamer_fx.records.plot.run_reader import RunReader

    run = RunReader(wanted.run)
    _write_and_print(
        wanted.output or wanted.run / "report.html", lambda path: write_report(run, path)
    )


def _export(wanted: argparse.Namespace, comm: MPI.Intracomm) -> None:
    """Write a run for ParaView, and print the path of the list of its states."""
    from gossamer_fx.records.plot.run_reader import RunReader
    from gossamer_fx.records.plot.vtk_export import export

    run = RunReader(wanted.run)
    _print_path(export(run, wanted.output or wanted.run / "vtu", every=wanted.every))


def _write_and_print(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file, and print its path."""
    write(path)
    _print_path(path)


def _print_path(path: Path) -> None:
    """Print a path, which scripts can read; a terminal gets no characters that control it."""
    if sys.stdout.isatty():
        print(shown(str(path)))
        return
    # A name may have bytes that are not UTF-8.
    sys.stdout.flush()
    sys.stdout.buffer.write(os.fsencode(path) + b"\n")
    sys.stdout.buffer.flush()

"""How a program ends: errors of one rank only, ranks whose launcher is gone, and signals that end a
run after the step that is being made.

Errors.  The other ranks would wait for a failed rank for ever.  So a rank with an error asks the
others whether they have an error of the same kind.  If all have, the error is raised on each of
them; otherwise the program ends on all ranks.

Signals.  A run notes them (`Listener`), completes its step, closes its files and raises
`Interrupted`.  `gossamer run` notes SIGTERM and SIGUSR1 from its beginning on, so that one that
comes before the first step leaves a checkpoint of the start.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import CodeType, FrameType, TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mpi4py import MPI


# Seconds for which a rank with an error waits for the others.
PATIENCE = 8.0

# Tag of the messages about errors, which no other part of the program uses.
TAG = 28531

# Tag of the messages by which a rank says that its program has come to its end.
ENDED_TAG = 28532

# Option of prctl(2): the signal that a process gets when its parent ends.
_PR_SET_PDEATHSIG = 1

# Numbers of tools of sys.monitoring that no debugger, coverage or profiler has by custom.
_TOOLS = (3, 4)

# Environment variables in which launchers of Open MPI, MPICH and Intel MPI set the number of ranks.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")


class CtrlC(KeyboardInterrupt):
    """Ctrl-C, as a signal that all ranks get; a function of the user that raises KeyboardInterrupt
    does so on its own rank."""


def raise_ctrl_c(number: int, frame: FrameType | None) -> None:
    """Handler of the signals by which Ctrl-C comes."""
    raise CtrlC


def lacks_room(error: BaseException) -> bool:
    """Whether there was no memory, or none to load a library."""
    if isinstance(error, MemoryError):
        return True
    # The words of the loader of Linux.
    words = ("failed to map segment", "annot allocate memory")
    return isinstance(error, ImportError | OSError) and any(w in str(error) for w in words)


def no_room(error: BaseException) -> str:
    """The sentence about an error for which `lacks_room` holds."""
    cause = " ".join(str(error).split()) or "no words"
    return (
        f"there is not enough memory ({cause}); free some, or raise the limit that ulimit -v or a "
        "batch system has set."
    )


@contextmanager
def abort_on_lone_error(comm: MPI.Intracomm) -> Iterator[None]:
    """Context, entered by all ranks, in which an error of one rank ends the program with the exit
    code 1, unless all ranks have one of the same class within `PATIENCE` seconds; that is raised.
    Otherwise the other ranks would wait for messages of this rank for ever."""
    try:
        yield
    # Ctrl-C reaches all ranks; the command says that it has ended them.
    except CtrlC:
        raise
    # A function of the user may raise anything on one rank, also what ends a program.
    except BaseException as error:
        agree_on_error(comm, error)
        raise


def agree_on_error(comm: MPI.Intracomm, error: BaseException) -> None:
    """Return if all ranks call this with an error of the same class; otherwise print the error of
    this rank and end all ranks with the exit code 1.  Ranks that do not call it within `PATIENCE`
    seconds count as without an error."""
    if comm.size == 1:
        return
    others = [r for r in range(comm.size) if r != comm.rank]
    mine = type(error).__qualname__
    sent = [comm.isend(mine, r, TAG) for r in others]
    awaited = {r: comm.irecv(source=r, tag=TAG) for r in others}
    deadline = time.monotonic() + PATIENCE
    kinds = {mine}
    while awaited or not all(request.test()[0] for request in sent):
        for r in list(awaited):
            arrived, kind = awaited[r].test()
            if arrived:
                kinds.add(str(kind))
                del awaited[r]
        if time.monotonic() > deadline or len(kinds) > 1:
            words = "the ranks failed in different ways, this one"
            if len(kinds) == 1:
                words = f"rank {comm.rank} failed alone"
            traceback.print_exception(error)
            cause = " ".join(str(error).split()) or "no words"
            sys.stderr.write(
                f"gossamer: {words} by {type(error).__name__} ({cause}) in the lines above; "
                "correct them, and go on from a checkpoint, if there is one, with --restart.\n"
            )
            sys.stderr.flush()
            comm.Abort(1)
        # Poll, since a blocking wait could not end after `PATIENCE`.
        time.sleep(1e-3)


def end_with_parent(number: int = signal.SIGKILL) -> None:
    """Let Linux send this process a signal when its parent has gone, e.g. mpirun.

    Without mpirun, killed because memory ran out, say, a rank waits for the others for ever, and
    holds the locks of its files.
    """
    if sys.platform != "linux":
        return
    parent = os.getppid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)
    # The parent may have gone before the call, which then has no effect.
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def watch_uncaught_errors() -> None:
    """Install a hook that ends the program on all ranks after an uncaught error of one rank, and
    let this process end with its launcher (`end_with_parent`).

    Such an error may occur while the scene is created.  Without the hook Python would wait in
    MPI_Finalize for the other ranks, which wait for this one.  Where a launcher has started one
    process only, or none has, nothing is done.
    """
    # One process has nobody to wait for it, and need not load MPI.
    if not any(os.environ.get(name, "1") not in ("", "0", "1") for name in _SIZES):
        return
    end_with_parent()
    usual = sys.excepthook

    def uncaught(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        usual(kind, error, trace)
        sys.stderr.flush()
        from mpi4py import MPI

        if not isinstance(error, CtrlC) and MPI.Is_initialized() and not MPI.Is_finalized():
            agree_on_error(MPI.COMM_WORLD, error)

    sys.excepthook = uncaught
    _watch_exits()


def _watch_exits() -> None:
    """Let a rank that ends by sys.exit with a code other than zero end the others, unless they come
    to their end, too, within `PATIENCE` seconds.

    With the code zero a rank waits for the others, as at the end of the script: one rank may go on
    for hours with what it does alone.
    """
    codes: list[object] = []

    def unwound(code: CodeType, offset: int, error: BaseException) -> None:
        """Note an exit that leaves the outermost function, where nobody can catch it."""
        if isinstance(error, SystemExit) and sys._getframe(1).f_back is None:
            codes.append(error.code)

    monitoring = sys.monitoring
    free = [number for number in _TOOLS if monitoring.get_tool(number) is None]
    if free:
        monitoring.use_tool_id(free[0], "gossamer_fx")
        monitoring.register_callback(free[0], monitoring.events.PY_UNWIND, unwound)
        monitoring.set_events(free[0], monitoring.events.PY_UNWIND)
    # Before MPI_Finalize, which waits for all ranks.
    atexit.register(lambda: _leave(codes[-1] if codes else None))


def _leave(code: object) -> None:
    """Say to the other ranks that this one ends with an exit code, and wait for them unless it is
    zero."""
    # A program without MPI does not load it for its end.
    loaded = sys.modules.get("mpi4py.MPI")
    if loaded is None or not loaded.Is_initialized() or loaded.Is_finalized():
        return
    comm = loaded.COMM_WORLD
    awaited = {r for r in range(comm.size) if r != comm.rank}
    for r in awaited:
        comm.isend(None, r, ENDED_TAG)
    if code is None or code == 0:
        return
    deadline = time.monotonic() + PATIENCE
    while awaited:
        # A rank with an error ends all by itself.
        awaited = {r for r in awaited if not (comm.iprobe(r, ENDED_TAG) or comm.iprobe(r, TAG))}
        if awaited and time.monotonic() > deadline:
            # Python prints a word in place of a number.
            number = code if isinstance(code, int) else 1
            sys.stderr.write(
                f"gossamer: rank {comm.rank} has ended alone by sys.exit({code!r}), and the others "
                "with it; let all ranks exit, or raise an error there.\n"
            )
            sys.stderr.flush()
            comm.Abort(number)
        time.sleep(1e-3)


# mpirun passes SIGUSR1 and SIGUSR2 on to its ranks; after the other two it kills them before a long
# step ends.
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1, signal.SIGUSR2)

# Environment variable with the name of a file that exists once the launcher has got a SIGTERM, and
# has handed it on as SIGUSR1.
TERMINATED = "GOSSAMER_TERMINATED"

# The exit code of a program that a signal ends is this number plus that of the signal.
EXIT_CODE_OFFSET = 128


class Interrupted(SystemExit):
    """A run ended because of a signal, with all its files closed.

    If it is not caught, it ends the program with the code 128 + number of the signal.

    Attributes:
        signal: the signal.  SIGUSR2, by which the launcher hands on Ctrl-C, is a SIGINT, and
            SIGUSR1 a SIGTERM if the launcher has got that.

    Example:
        >>> import signal
        >>> gx.run.Interrupted(signal.SIGINT).code
        130
    """

    def __init__(self, number: int) -> None:
        if number == signal.SIGUSR2:
            number = signal.SIGINT
        terminated = os.environ.get(TERMINATED)
        if number == signal.SIGUSR1 and terminated and os.path.exists(terminated):
            number = signal.SIGTERM
        super().__init__(EXIT_CODE_OFFSET + number)
        self.signal = signal.Signals(number)


# Listeners whose contexts are entered, the innermost last.
_LISTENING: list[Listener] = []


class Listener:
    """Context in which signals, by default `SIGNALS`, are noted instead of having their usual
    effect, also for a context within it.  A second signal of the same kind has its usual effect, so
    that a step that never ends can be stopped."""

    def __init__(self, signals: Sequence[signal.Signals] = SIGNALS) -> None:
        self._signals = signals
        self._noted = 0
        self._usual: dict[int, Any] = {}  # handlers outside the context

    def __enter__(self) -> Listener:
        # Python lets only the main thread set handlers; a run in another thread is not interrupted.
        if threading.current_thread() is threading.main_thread():
            if _LISTENING:
                self._noted = _LISTENING[-1]._noted
            _LISTENING.append(self)
            for number in self._signals:
                # A second one has its usual effect.
                if number != self._noted:
                    self._usual[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number in self._usual:
            self._restore_handler(number)
        if self in _LISTENING:
            _LISTENING.remove(self)

    def _note(self, number: int, frame: FrameType | None) -> None:
        """Note a signal, and give the next one of its kind its usual effect; called by Python."""
        self._noted = number
        self._restore_handler(number)

    def _restore_handler(self, number: int) -> None:
        """Give a signal its usual effect."""
        usual = self._usual[number]
        # None: the handler was not set by Python, and Python cannot set it again.
        if usual is None:
            usual = signal.SIG_DFL
        signal.signal(number, usual)

    def heard(self, comm: MPI.Intracomm) -> int:
        """The number of a signal that any rank has received, or zero; the same on every rank.
        Collective."""
        # Loaded by runs only, so that the import of the package is cheap.
        from mpi4py import MPI

        return int(comm.allreduce(self._noted, op=MPI.MAX))

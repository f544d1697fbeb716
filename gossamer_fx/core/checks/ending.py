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

from gossamer_fx.core.checks.ctrl_c import EXIT_CODE_OFFSET, CtrlC

if TYPE_CHECKING:
    from mpi4py import MPI


# Seconds for which a rank with an error waits for the others.  With the two seconds in which mpirun
# ends all ranks they are less than 10.
PATIENCE = 6.0

# Tag of the messages about errors, which no other part of the program uses.
TAG = 28531

# Tag of the messages by which a rank says that its program has come to its end.
ENDED_TAG = 28532

# Tags of the messages that answer it: a rank goes on, or waits for others in a call of mpi4py.
GOES_ON_TAG = 28533
WAITS_TAG = 28534

# Seconds between such answers, and the number of times within `PATIENCE` at which they are read.
BEAT = 0.5
LOOKS = 4

# Option of prctl(2): the signal that a process gets when its parent ends.
_PR_SET_PDEATHSIG = 1

# Numbers of tools of sys.monitoring that no debugger, coverage or profiler has by custom.
_TOOLS = (3, 4)

# Environment variables in which launchers of Open MPI, MPICH and Intel MPI set the number of ranks.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")


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
    """Let a rank that ends alone end the others.

    After sys.exit with a code other than zero they have `PATIENCE` seconds to come to their end,
    too.  A rank that exits with zero, or comes to the end of its script, waits for the others as
    long as one of them goes on, maybe for hours; if all that remain wait for it, they are ended.
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
    from gossamer_fx.core.checks.waiting import yield_while_waiting

    yield_while_waiting()
    answering = _Answering()
    answering.start()

    def leave() -> None:
        # Threads of the user may go on with messages.
        for thread in threading.enumerate():
            if thread is not threading.main_thread() and not thread.daemon:
                thread.join()
        answering.stop()
        _leave(codes[-1] if codes else None)

    # Before the functions of atexit, of which PetscFinalize and then MPI_Finalize wait for all
    # ranks; concurrent.futures ends its threads in this way, too.
    threading._register_atexit(leave)  # type: ignore[attr-defined]


def _running_mpi() -> Any:
    """The module mpi4py.MPI between the start and the end of MPI, else None."""
    # A program without MPI does not load it.
    loaded = sys.modules.get("mpi4py.MPI")
    # It is in the list of modules before it has been executed.
    if loaded is None or not hasattr(loaded, "COMM_WORLD"):
        return None
    if not loaded.Is_initialized() or loaded.Is_finalized():
        return None
    return loaded


class _Answering(threading.Thread):
    """Tells ranks that have ended whether this one goes on, or waits for others."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._stopped = threading.Event()

    def stop(self) -> None:
        """End the thread: MPI_Finalize must find no other call of MPI."""
        self._stopped.set()
        self.join()

    def run(self) -> None:
        """Answer all ranks that have ended, until this one ends."""
        from gossamer_fx.core.checks.waiting import MainThread

        main_thread = MainThread()
        while not self._stopped.wait(BEAT):
            mpi = _running_mpi()
            if mpi is None or mpi.Query_thread() != mpi.THREAD_MULTIPLE:
                continue
            comm = mpi.COMM_WORLD
            if not comm.iprobe(mpi.ANY_SOURCE, ENDED_TAG):
                continue
            tag = WAITS_TAG if main_thread.waits_for_ranks() else GOES_ON_TAG
            for r in range(comm.size):
                # The message stays: the main thread asks for it, too.
                if r != comm.rank and comm.iprobe(r, ENDED_TAG):
                    comm.Isend((None, 0, mpi.BYTE), r, tag)


def _leave(code: object) -> None:
    """Say to the other ranks that this one ends with an exit code, and wait for them."""
    mpi = _running_mpi()
    if mpi is None:
        return
    comm = mpi.COMM_WORLD
    for r in range(comm.size):
        if r != comm.rank:
            comm.isend(None, r, ENDED_TAG)
    if code is not None and code != 0:
        _wait_after_failure(comm, code)
    elif mpi.Query_thread() == mpi.THREAD_MULTIPLE:
        _wait_as_long_as_others_go_on(mpi)


def _going(comm: MPI.Intracomm) -> set[int]:
    """The other ranks that have not ended; a rank with an error ends all by itself."""
    others = (r for r in range(comm.size) if r != comm.rank)
    return {r for r in others if not (comm.iprobe(r, ENDED_TAG) or comm.iprobe(r, TAG))}


def _wait_after_failure(comm: MPI.Intracomm, code: object) -> None:
    """Wait for the others for `PATIENCE` seconds, then end them."""
    deadline = time.monotonic() + PATIENCE
    while _going(comm):
        if time.monotonic() > deadline:
            # Python prints a word in place of a number.
            number = code if isinstance(code, int) else 1
            _end_others(comm, f"by sys.exit({code!r}), and the others", number)
        time.sleep(1e-3)


def _wait_as_long_as_others_go_on(mpi: Any) -> None:
    """Wait for the others; end them if all that remain wait for others for `PATIENCE` seconds."""
    from gossamer_fx.core.checks.waiting import has_waited, uses_of_ranks

    comm = mpi.COMM_WORLD
    looks_in_vain = 0
    uses = uses_of_ranks()
    while _going(comm):
        deadline = time.monotonic() + PATIENCE / LOOKS
        while time.monotonic() < deadline and _going(comm):
            time.sleep(BEAT / 20)
        before = uses
        uses = uses_of_ranks()
        waiting = _answers(mpi, WAITS_TAG)
        silent = _going(comm) - waiting
        # Some do not answer in a library that lets no other thread go on.
        known = silent <= before.keys() & uses.keys()
        in_vain = known and all(has_waited(before[r], uses[r]) for r in silent)
        looks_in_vain += 1
        if _answers(mpi, GOES_ON_TAG) or not in_vain:
            looks_in_vain = 0
        if looks_in_vain >= LOOKS and _going(comm):
            how = "at the end of its script or by sys.exit, and the others, which wait for it,"
            _end_others(comm, how, 1)


def _end_others(comm: MPI.Intracomm, how: str, code: int) -> None:
    """Say how this rank has ended, and end all."""
    sys.stderr.write(
        f"gossamer: rank {comm.rank} has ended alone {how} with it; let all ranks exit, or raise "
        "an error there.\n"
    )
    sys.stderr.flush()
    comm.Abort(code)


def _answers(mpi: Any, tag: int) -> set[int]:
    """The ranks whose answers of a kind have arrived."""
    comm = mpi.COMM_WORLD
    ranks = set()
    status = mpi.Status()
    while comm.iprobe(mpi.ANY_SOURCE, tag, status):
        comm.Recv((None, 0, mpi.BYTE), status.Get_source(), tag)
        ranks.add(status.Get_source())
    return ranks


# mpirun passes SIGUSR1 and SIGUSR2 on to its ranks; after the other two it kills them before a long
# step ends.
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1, signal.SIGUSR2)

# Environment variable with the name of a file that exists once the launcher has got a SIGTERM, and
# has handed it on as SIGUSR1.
TERMINATED = "GOSSAMER_TERMINATED"


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

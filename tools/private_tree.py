"""The private Debian 13 tree of the launcher: the end of its making, and entering it.

    python3 -I -S private_tree.py finish TREE               TREE.partial is complete: make it TREE
    python3 -I -S private_tree.py enter TREE LAUNCHER WORDS  run a command of the launcher in TREE

The launcher runs this with the tree's own Python before the tree has been entered: what is imported
here comes with Python, and paths are those of the machine.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

# files of the machine that are used in a tree, too
OWN_FILES = (
    "/etc/passwd",
    "/etc/group",
    "/etc/hosts",
    "/etc/hostname",
    "/etc/resolv.conf",
    "/etc/localtime",
    "/etc/pip.conf",
    "/etc/ssl/certs/ca-certificates.crt",
)
# Folders of a tree that stand over the machine's; the last one so that no apt-get inside changes
# what the machine knows of its packages.
REPLACED = ("/usr", "/etc", "/var/lib/dpkg")
# links into /usr, or separate folders on machines that were installed long ago
OUTSIDE_USR = ("/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")
PATH_IN_A_WORD = re.compile(r"/(?:usr|etc)/[^][ ,:;=(){}<>|&\"']+")
UNUSED_AFTER = 24 * 3600.0  # s
HANDED_ON = (signal.SIGHUP, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2)

Binding = tuple[str, str]


def fail(words: str) -> NoReturn:
    """End the program with a sentence."""
    sys.exit(f"gossamer: {words}")


# ---- making --------------------------------------------------------------------------------------


def finish(tree: Path) -> None:
    """Complete a tree, which is named TREE.partial until then, and remove trees of other lists."""
    partial = tree.with_name(f"{tree.name}.partial")
    for name in OWN_FILES:
        # a regular file that the machine's can be mounted over: some are links at first
        place = Path(f"{partial}{name}")
        place.unlink(missing_ok=True)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
        if os.path.isfile(name):
            place.write_bytes(Path(name).read_bytes())
    (partial / ".used").touch()
    (partial / ".complete").write_text(f"made until {time.ctime()}\n")
    if tree.exists():  # but not complete
        remove_in_background([tree])
    partial.rename(tree)
    remove_in_background(unused_trees(tree))


def unused_trees(tree: Path) -> list[Path]:
    """Other trees in the same folder that no process uses, and nobody has used for a day."""
    found = []
    for other in sorted(tree.parent.glob("debian13-*/")):
        used = other / ".used"
        if other == tree:
            continue
        if used.exists():
            if time.time() - used.stat().st_mtime < UNUSED_AFTER:
                continue
            with used.open() as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:  # a command in this tree holds it
                    continue
                # who comes later finds that the tree is not complete
                (other / ".complete").unlink(missing_ok=True)
        found.append(other)
    return found


def remove_in_background(trees: Sequence[Path]) -> None:
    """Remove trees.  That takes minutes on some disks: nobody waits for it."""
    removed = []
    for tree in trees:
        trash = tree.with_name(f"trash-{os.getpid()}-{tree.name}")
        tree.rename(trash)
        tree.with_name(f"{tree.name}.log").unlink(missing_ok=True)
        removed.append(str(trash))
    if removed:
        # not what a killed set-up has left mounted
        subprocess.Popen(["rm", "-rf", "--one-file-system", *removed])


# ---- what is mounted where -----------------------------------------------------------------------


def bindings(tree: str, words: Sequence[str]) -> Iterator[Binding]:
    """What is mounted where, in this order: pairs of a path of the machine and its path in the
    tree.

    Args:
        tree: of Debian 13.
        words: of the command, which may name paths that it needs.
    """
    for name in REPLACED:
        yield tree + name, name
    for name in OUTSIDE_USR:
        inside = f"{tree}/usr{name}"
        if os.path.isdir(name) and not os.path.islink(name) and os.path.isdir(inside):
            yield inside, name
    for name in OWN_FILES:
        if os.path.isfile(name) and os.path.isfile(tree + name):
            yield name, name
    for path in named_paths(words):
        # a file that will be written needs the folder for it
        while not os.path.exists(path):
            path = os.path.dirname(path)
        if path in ("/usr", "/etc"):
            continue
        # only empty folders of a tree are in /usr/local
        is_local = path == "/usr/local" or path.startswith("/usr/local/")
        if not is_local and is_filled(tree + path):
            continue
        with contextlib.suppress(OSError):  # a tree that somebody else has made
            make_place(tree + path, os.path.isdir(path))
            yield path, path


def named_paths(words: Sequence[str]) -> list[str]:
    """Paths under the replaced folders that a command may want.

    Where it runs, the folders that it always uses, and all that its words name.
    """
    folders = (
        os.environ.get("PWD", ""),
        os.environ.get("HOME", ""),
        os.environ.get("TMPDIR", "/tmp"),
        os.environ.get("XDG_CACHE_HOME", ""),
        os.path.dirname(os.path.dirname(os.path.abspath(__file__))),
    )
    found = set()
    for word in (*folders, *words):
        if word:
            found.add(os.path.abspath(word))
            found.add(os.path.realpath(word))
        found.update(PATH_IN_A_WORD.findall(word))
    return sorted(path for path in found if path.startswith(("/usr/", "/etc/")))


def is_filled(path: str) -> bool:
    """Whether a folder or file of a tree has content itself."""
    try:
        if os.path.isdir(path):
            return bool(os.listdir(path))
        return os.path.getsize(path) > 0
    except OSError:
        return False


def make_place(path: str, is_folder: bool) -> None:
    """Make an empty folder or file to mount something over, if it is not there."""
    if is_folder:
        os.makedirs(path, exist_ok=True)
    else:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        Path(path).touch()


# ---- entering ------------------------------------------------------------------------------------


def enter_as_root(tree: str, command: Sequence[str]) -> NoReturn:
    """Mount and change the root; the command replaces this process, so that it gets its signals.

    The launcher has put this process into a separate mount namespace.
    """
    stage = f"{tree}/mnt"
    mount("--rbind", "/", stage)
    for source, place in bindings(tree, command):
        mount("--bind", source, stage + place)
    for name in ("/usr", "/etc"):
        # on some systems a bind mount cannot be made read-only
        subprocess.run(
            ["mount", "-o", "remount,bind,ro", stage + name],
            stderr=subprocess.DEVNULL,
        )
    here = os.environ.get("PWD") or os.getcwd()
    os.chroot(stage)
    try:
        os.chdir(here)
    except OSError:
        os.chdir("/")
    os.execv("/bin/sh", ["sh", *command])


def mount(*words: str) -> None:
    """Run mount.

    Raises:
        SystemExit: it fails.
    """
    done = subprocess.run(["mount", *words], stderr=subprocess.PIPE, text=True)
    if done.returncode:
        fail(f"mount {' '.join(words)} failed ({done.stderr.strip()}).")


def enter_as_user(tree: str, command: Sequence[str]) -> int:
    """Run a command by bwrap, which keeps signals to itself: they are handed on to its child.

    Returns:
        The exit code of the command; 128 + signal if a signal ended it.
    """
    if shutil.which("bwrap") is None:
        fail("please install bubblewrap: sudo apt-get install bubblewrap")
    arguments = [word for pair in bindings(tree, command) for word in ("--bind", *pair)]
    file = os.memfd_create("bindings")
    os.write(file, b"".join(os.fsencode(word) + b"\0" for word in arguments))
    os.lseek(file, 0, os.SEEK_SET)
    bwrap = ["bwrap", "--die-with-parent", "--dev-bind", "/", "/", "--args", str(file)]
    read_only = ["--remount-ro", "/usr", "--remount-ro", "/etc"]
    child: subprocess.Popen[bytes] | None = None

    def hand_on(number: int, frame: FrameType | None) -> None:
        if child is None:
            sys.exit(128 + number)
        with contextlib.suppress(OSError):
            os.kill(inner_process(child.pid), number)

    for number in HANDED_ON:
        signal.signal(number, hand_on)
    # A terminal sends Ctrl-C to the command itself; a second one would be taken for impatience.
    if any(os.isatty(stream) for stream in (0, 1, 2)):
        signal.signal(signal.SIGINT, lambda number, frame: None)
    else:
        signal.signal(signal.SIGINT, hand_on)
    # bwrap would die of the Ctrl-C of a terminal, and with it the command, which may want to live
    usual = ["/usr/bin/env", "--default-signal=INT,QUIT", "sh"]
    os.set_inheritable(file, True)
    child = subprocess.Popen(
        [*bwrap, *read_only, *usual, *command],
        close_fds=False,  # the command gets what this process has been given
        preexec_fn=ignore_the_terminal,
    )
    code = child.wait()
    if code < 0:
        return 128 - code
    return code


def ignore_the_terminal() -> None:
    """Ignore Ctrl-C and Ctrl-\\ in this process and in those that it starts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGQUIT, signal.SIG_IGN)


def inner_process(bwrap: int) -> int:
    """The process that bwrap has started, or that of bwrap before it has."""
    children = Path(f"/proc/{bwrap}/task/{bwrap}/children").read_text().split()
    return int(children[0]) if children else bwrap


def main(words: Sequence[str]) -> int:
    """Do what the words say; returns an exit code."""
    if words[0] == "finish":
        finish(Path(words[1]))
        return 0
    _, tree, launcher, *rest = words
    command = [launcher, "--inside", *rest]
    if os.geteuid() == 0:
        # what Python changes at its start, and a program that replaces it inherits
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        enter_as_root(tree, command)
    return enter_as_user(tree, command)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

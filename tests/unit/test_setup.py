"""The first start on a bare machine: what the launcher sets up, says and leaves behind.

The machine is a fake: a copy of the launcher asks other files than those of this system, and finds
other programs first on PATH.  They do what apt-get, mmdebstrap and so on do that matters here.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ, reason="one rank is enough"
)

# A program that has started, has children, and tidies up when it is ended, as mmdebstrap does.  Of
# One of the children has a separate process group, and one a session, as dpkg under apt-get.
AT_WORK = f"""
/bin/sleep 600 & first=$!
{sys.executable} -c 'import os; os.setpgid(0, 0); os.execv("/bin/sleep", ["sleep", "600"])' &
second=$!
setsid /bin/sleep 600 &
trap '/bin/sleep 0.5; kill $first $second; exit 1' TERM INT HUP
echo $$ >> "$HERE/started"
while [ ! -e "$HERE/go on" ]; do /bin/sleep 0.05; done
kill $first $second $!
trap - TERM INT HUP
"""
# Of the tree that mmdebstrap makes, what the launcher needs: a loader that starts this test's
# Python for the end of the set-up, and runs commands of the launcher without entering the tree.
MAKE_TREE = """
mkdir -p "$target/usr/bin" "$target/usr/lib/x-linux-gnu" "$target/etc"
: > "$target/usr/bin/python3"
cp "$HERE/loader" "$target/usr/lib/x-linux-gnu/ld-fake.so.2"
"""
LOADER = """#!/bin/sh
shift 3
[ "$4" != enter ] || { shift 5; exec sh "$1" --inside "$2"; }
exec {python} "$@"
"""
PROGRAMS = {
    "python3": "exit 1",
    "sleep": "exec /bin/sleep 0.05",
    "unshare": 'while [ "${1#--}" != "$1" ]; do shift; done; [ "$1" = mount ] || exec "$@"',
    "newuidmap": "",
    "bwrap": "",
    "apt-config": "",
    "dpkg": "",
    "apt-cache": "echo 'Candidate: 1:0.9.0-10'",
    "apt-get": """
echo "apt-get $*" >> "$HERE/calls"
. "$HERE/apt-get does"
""",
    "mmdebstrap": """
echo "mmdebstrap" >> "$HERE/calls"
. "$HERE/mmdebstrap does"
case $* in
    *--mode=unshare*)
        target=$HERE/made
        {make_tree}
        tar -c -C "$target" . ;;
    *)
        for word; do case $word in *.partial) target=$word ;; esac; done
        {make_tree} ;;
esac
""".replace("{make_tree}", MAKE_TREE),
}


class Machine:
    """A machine without dolfinx, and its user.

    Args:
        home: where everything of it is.
        user: "root" or another name.
    """

    def __init__(self, home: Path, user: str) -> None:
        self.home = home
        self.cache = home / "the cache" / "gossamer_fx"
        self.mark = uuid.uuid4().hex
        self._programs = home / "programs"
        self._programs.mkdir(parents=True)
        for name, body in PROGRAMS.items():
            self.install(name, body)
        self.install("id", f"echo {0 if user == 'root' else 1000}")
        self.does("mmdebstrap", "")
        self.does("apt-get", "")
        (home / "loader").write_text(LOADER.replace("{python}", sys.executable))
        (home / "loader").chmod(0o755)
        (home / "keys.gpg").touch()
        self.is_debian(12)
        self._copy_launcher()

    def _copy_launcher(self) -> None:
        project = self.home / "project"
        project.mkdir()
        shutil.copy(ROOT / "pyproject.toml", project)
        shutil.copytree(ROOT / "tools", project / "tools")
        text = (ROOT / "gossamer").read_text()
        for real, fake in (
            (" /usr/bin/python3", f" {self.home}/system-python3"),
            ("/etc/os-release", f"{self.home}/os-release"),
            ("/usr/share/keyrings/debian-archive-keyring.gpg", f"{self.home}/keys.gpg"),
            ("[6-9][0-9] | ???", "[4-9][0-9]"),
            # entering the tree is the loader's here
            ("apart='unshare --mount --propagation slave'", "apart=''"),
        ):
            assert real in text
            text = text.replace(real, fake)
        (project / "gossamer").write_text(text)
        (project / "gossamer").chmod(0o755)

    def is_debian(self, version: int) -> None:
        (self.home / "os-release").write_text(f'ID=debian\nVERSION_ID="{version}"\n')

    def install(self, name: str, body: str) -> None:
        path = self._programs / name
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(0o755)

    def remove(self, name: str) -> None:
        (self._programs / name).unlink()
        # those of this system must not be found instead: none is needed for what is tested
        assert shutil.which(name, path="/usr/bin:/bin:/usr/sbin:/sbin") is None or name == "bwrap"

    def does(self, name: str, body: str) -> None:
        """What a program does first from now on."""
        (self.home / f"{name} does").write_text(f"{body}\n")

    def start(self, *words: str) -> subprocess.Popen[str]:
        environment = {
            "PATH": f"{self._programs}:/usr/bin:/bin",
            "HOME": str(self.home),
            "HERE": str(self.home),
            "XDG_CACHE_HOME": str(self.home / "the cache"),
            "MARK": self.mark,
        }
        # which are ignored if these tests run in the background of a shell
        signals = ["env", "--default-signal=INT,QUIT"]
        return subprocess.Popen(
            [*signals, str(self.home / "project" / "gossamer"), *words],
            env=environment,
            cwd=self.home,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def set_up(self) -> tuple[int, str]:
        """Exit code of `./gossamer setup`, and the sentences that it says."""
        run = self.start("setup")
        said = run.communicate(timeout=HANG_TIMEOUT)[1]
        return run.returncode, said

    def calls(self) -> list[str]:
        path = self.home / "calls"
        return path.read_text().splitlines() if path.exists() else []

    def started(self) -> int:
        path = self.home / "started"
        return len(path.read_text().splitlines()) if path.exists() else 0

    def processes(self) -> list[str]:
        """Command lines of the processes that the launcher has started and that live."""
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                if f"MARK={self.mark}".encode() in (entry / "environ").read_bytes():
                    found.append((entry / "cmdline").read_bytes().replace(b"\0", b" ").decode())
            except OSError:
                continue
        return found

    def end_all(self) -> None:
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                if f"MARK={self.mark}".encode() in (entry / "environ").read_bytes():
                    os.kill(int(entry.name), signal.SIGKILL)
            except OSError:
                continue


def wait_until(happened: Callable[[], object]) -> None:
    deadline = time.monotonic() + HANG_TIMEOUT
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.fixture(params=["root", "user"])
def machine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Machine]:
    """A machine with the tools that a set-up needs."""
    it = Machine(tmp_path / "machine", request.param)
    yield it
    it.end_all()


@pytest.fixture
def root_machine(tmp_path: Path) -> Iterator[Machine]:
    it = Machine(tmp_path / "machine", "root")
    yield it
    it.end_all()


def test_the_first_start_makes_a_tree_and_the_second_finds_it(machine: Machine) -> None:
    code, said = machine.set_up()
    assert code == 0, said
    assert "making a private Debian 13" in said and "ready: a private Debian 13 tree" in said
    [tree] = [path for path in machine.cache.iterdir() if path.is_dir()]
    assert (tree / ".complete").is_file() and (tree / "etc" / "passwd").is_file()
    assert machine.set_up() == (0, f"gossamer: ready: a private Debian 13 tree, {tree}.\n")
    assert machine.calls() == ["mmdebstrap"]
    assert not machine.processes()


def test_a_second_set_up_waits_for_the_first(machine: Machine) -> None:
    machine.does("mmdebstrap", AT_WORK)
    first = machine.start("setup")
    wait_until(machine.started)
    second = machine.start("setup")
    assert second.stderr is not None
    assert "another set-up is at work" in second.stderr.readline()
    (machine.home / "go on").touch()
    for run in (first, second):
        said = run.communicate(timeout=HANG_TIMEOUT)[1]
        assert run.returncode == 0 and "ready" in said, said
    assert machine.calls() == ["mmdebstrap"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_an_interrupted_set_up_leaves_no_process(machine: Machine, number: signal.Signals) -> None:
    """Also none in a separate process group or session."""
    machine.does("mmdebstrap", AT_WORK)
    run = machine.start("setup")
    wait_until(machine.started)
    assert len(machine.processes()) > 5
    run.send_signal(number)
    said = run.communicate(timeout=HANG_TIMEOUT)[1]
    assert not machine.processes()
    assert run.returncode == 128 + number
    assert said.endswith("gossamer: set-up interrupted.\n")
    assert not list(machine.cache.glob("*.partial")) and not list(machine.cache.glob("trash-*"))
    machine.does("mmdebstrap", "")
    assert machine.set_up()[0] == 0


def test_what_does_not_end_is_killed(machine: Machine) -> None:
    machine.does("mmdebstrap", 'trap "" TERM; echo 1 >> "$HERE/started"; /bin/sleep 600')
    run = machine.start("setup")
    wait_until(machine.started)
    run.send_signal(signal.SIGTERM)
    run.communicate(timeout=HANG_TIMEOUT)
    assert not machine.processes() and run.returncode == 128 + signal.SIGTERM


def test_interrupted_while_tools_are_installed(root_machine: Machine) -> None:
    root_machine.remove("mmdebstrap")
    root_machine.does("apt-get", AT_WORK)
    run = root_machine.start("setup")
    wait_until(root_machine.started)
    run.send_signal(signal.SIGTERM)
    said = run.communicate(timeout=HANG_TIMEOUT)[1]
    assert not root_machine.processes()
    assert run.returncode == 128 + signal.SIGTERM and "set-up interrupted" in said


def test_who_waits_may_be_interrupted_and_the_first_goes_on(machine: Machine) -> None:
    machine.does("mmdebstrap", AT_WORK)
    first = machine.start("setup")
    wait_until(machine.started)
    busy = len(machine.processes())
    second = machine.start("setup")
    assert second.stderr is not None and "another" in second.stderr.readline()
    second.send_signal(signal.SIGTERM)
    second.communicate(timeout=HANG_TIMEOUT)
    assert second.returncode == 128 + signal.SIGTERM
    # short-lived ones, which ask every second, are not counted twice
    wait_until(lambda: len(machine.processes()) <= busy)
    assert list(machine.cache.glob("*.partial"))
    (machine.home / "go on").touch()
    said = first.communicate(timeout=HANG_TIMEOUT)[1]
    assert first.returncode == 0, said


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ("tar: ./usr: Cannot write: No space left on device", "because the disk is full; see "),
        (
            "E: GPG error: trixie InRelease: NO_PUBKEY 6ED0E7B82643E131",
            "because this machine lacks the signing keys of Debian 13: install a newer",
        ),
        ("E: Could not resolve 'deb.debian.org'", "because http://deb.debian.org/debian could not"),
        ("E: something else", "set-up failed; see the end of "),
    ],
)
def test_why_a_set_up_failed_is_one_sentence(machine: Machine, told: str, words: str) -> None:
    machine.does("mmdebstrap", f'echo "{told}" >&2; exit 100')
    code, said = machine.set_up()
    # on a busy machine the stage is told, too
    first, *stages, last = said.splitlines()
    assert code == 1 and "making" in first
    assert all(re.fullmatch(r"gossamer: \d+ s: .*", line) for line in stages)
    assert last.startswith("gossamer: set-up failed") and words in last
    assert not list(machine.cache.glob("*.partial")) and not machine.processes()
    # a mirror may have a bad moment, a full disk stays full
    tries = 1 if "space" in told else 3
    assert machine.calls().count("mmdebstrap") == tries


def test_too_little_space_is_said_before_anything_is_made(machine: Machine) -> None:
    machine.install("df", 'echo header; echo "/dev/x 9 9 2048000 1% /"')
    code, said = machine.set_up()
    assert code == 1 and not machine.calls()
    assert "the set-up needs 3500 MB in " in said and ", where 2000 MB are free." in said
    assert said.count("\n") == 1


def test_an_ordinary_user_is_told_which_tools_are_missing(tmp_path: Path) -> None:
    machine = Machine(tmp_path / "machine", "user")
    machine.remove("mmdebstrap")
    (machine.home / "keys.gpg").unlink()
    code, said = machine.set_up()
    assert code == 1 and said.count("\n") == 1
    assert "sudo apt-get install mmdebstrap debian-archive-keyring" in said


def test_root_gets_missing_tools(root_machine: Machine) -> None:
    root_machine.remove("mmdebstrap")
    target = root_machine.home / "programs" / "mmdebstrap"
    (root_machine.home / "mmdebstrap program").write_text(f"#!/bin/sh\n{PROGRAMS['mmdebstrap']}")
    root_machine.does("apt-get", f'cp "$HERE/mmdebstrap program" "{target}"; chmod +x "{target}"')
    code, said = root_machine.set_up()
    assert code == 0, said
    [install, made] = root_machine.calls()
    assert install.endswith("install mmdebstrap") and made == "mmdebstrap"


def test_debian_13_gets_the_packages(root_machine: Machine) -> None:
    """As root, with apt-get; the next start uses the python3 of the machine."""
    root_machine.is_debian(13)
    python = root_machine.home / "system-python3"
    python.write_text('#!/bin/sh\n[ -e "$HERE/installed" ]\n')
    python.chmod(0o755)
    root_machine.does("apt-get", 'case $* in *python3-dolfinx-real*) : > "$HERE/installed" ;; esac')
    code, said = root_machine.set_up()
    assert code == 0 and f"ready: this machine, {python}.\n" in said
    update, install = root_machine.calls()
    assert update.endswith("update") and "python3-gmsh" in install
    assert root_machine.set_up() == (0, f"gossamer: ready: this machine, {python}.\n")


def test_another_system_is_told_to_use_conda(machine: Machine) -> None:
    (machine.home / "os-release").write_text("ID=fedora\nVERSION_ID=43\n")
    code, said = machine.set_up()
    assert code == 1 and said.count("\n") == 1 and "conda" in said and not machine.calls()

"""Every command on a page is right, and those of the guides run in order, in one clean folder.

A command is a line of a block of shell, a line that is indented as code, or code within a sentence.
All of them are parsed: programs, files, options and names of arguments exist.  Those of README and
of the guides are run one after the other, as a reader would; what takes more than some ten seconds
has quick arguments, in `QUICK`, or is run by `./gossamer test -m slow tests/docs`.  Studies,
validations and benchmarks are run by tests of their own.
"""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

import gossamer_fx as gx
from gossamer_fx.app.cli.command import _parser, _with_values
from gossamer_fx.app.cli.demo import demos_of
from tests.hanging import HANG_TIMEOUT

ROOT = Path(gx.__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
# Pages whose commands a reader types one after the other.
FIRST = ["install.md", "first_steps.md"]
GUIDES = [
    ROOT / "README.md",
    *(ROOT / "docs" / name for name in FIRST),
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^ {4}(\./gossamer[^\n]*)$", re.MULTILINE)
INLINE = re.compile(r"`((?:\./)?gossamer [^`\n]*)`")
# Words that stand for one of the reader.
PLACEHOLDER = re.compile(r"[A-Z]{1,6}(\.\w+)?|\.\.\.|NAME=VALUE.*|folder/.*|scene\.py|FOLDER")
COMMANDS = ("run", "watch", "sweep", "plot", "report", "export", "demo", "doctor", "--help")
# Names of comparisons of errors, which share the problems of the benchmarks.
ERRORS = ("strip", "ring", "airbag", "blown", "thrown", "sheet", "contact", "pendulum")
# Arguments with which a command of a guide takes seconds.
QUICK = {
    "watch demos/inflatables/pillow.py cells=12 --output out/watched": (
        "watch demos/inflatables/pillow.py cells=4 until=0.02 --output out/watched"
    ),
    "run demos/inflatables/pillow.py cells=12 --output out/exported": (
        "run demos/inflatables/pillow.py cells=4 until=0.02 --output out/exported"
    ),
    "demo pillow": "demo pillow",
    "run demos/inflatables/pillow.py cells=12 --output out/pillow_12": (
        "run demos/inflatables/pillow.py cells=4 until=0.02 --output out/pillow_12"
    ),
    "run demos/films/spinning_sheet.py n=8 until=0.05 --output out/sheet": (
        "run demos/films/spinning_sheet.py n=4 until=0.01 --output out/sheet"
    ),
    "sweep demos/inflatables/pillow.py --over cells=4,8 dt=1e-3,5e-4": (
        "sweep demos/inflatables/pillow.py until=0.004 --over cells=4,6 dt=1e-3,5e-4"
    ),
    "run demos/inflatables/inflate_tube.py cells=6 until=0.005 --output out/tube": (
        "run demos/inflatables/inflate_tube.py cells=6 until=0.002 --output out/tube"
    ),
}


def plain(words: str) -> str:
    """A command without comment, launcher and the end of a sentence."""
    without = re.sub(r"\s+#.*$", "", words).strip()
    return re.sub(r"^(\./)?gossamer\s*", "", without)


def commands_of(page: Path) -> list[str]:
    """The commands of a page without the launcher, in the order in which they stand."""
    text = page.read_text(encoding="utf-8")
    found: list[tuple[int, str]] = []
    blanked = text
    for block in BLOCK.finditer(text):
        blanked = blanked.replace(block[0], " " * len(block[0]), 1)
        if block[1] in ("sh", "bash", "console"):
            lines = block[2].replace("\\\n", " ").splitlines()
            found += [(block.start(), line) for line in lines if line.startswith("./gossamer")]
    for pattern in (INDENTED, INLINE):
        found += [(one.start(), one[1]) for one in pattern.finditer(blanked)]
    return [plain(words) for _, words in sorted(found, key=lambda one: one[0])]


def all_commands() -> Iterator[tuple[str, str]]:
    """Name of the page and command, of all pages, each once."""
    seen = set()
    for page in PAGES:
        for words in commands_of(page):
            if words and words not in seen:
                seen.add(words)
                yield page.name, words


def is_known(word: str) -> bool:
    """Whether a word is one that readers take as it is."""
    return not PLACEHOLDER.fullmatch(word)


def arguments_of_build(path: Path) -> set[str]:
    """Names of the arguments of the function `build` of a scene file, without running it."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == "build":
            arguments = node.args
            if arguments.kwarg is None:
                return {one.arg for one in (*arguments.args, *arguments.kwonlyargs)}
    return set()


def what_is_wrong(command: str) -> str:
    """Why a command cannot work; empty words if nothing is seen."""
    name, *words = shlex.split(command)
    if name in ("study", "bench", "validate", "demo"):
        if name == "demo":
            known = set(demos_of(ROOT / "demos"))
        elif name == "bench":
            text = (ROOT / "demos/benchmarks/problems.toml").read_text(encoding="utf-8")
            tables = re.findall(r"^\[(\w+)", text, re.MULTILINE)
            known = {*tables, *(f"errors_{one}" for one in (*tables, *ERRORS)), "errors", "all"}
        else:
            folder = {"study": "studies", "validate": "validation/cases"}[name]
            known = {path.stem for path in (ROOT / "demos" / folder).glob("*.*")} | {"all"}
        if words and is_known(words[0]) and words[0] not in known:
            return f"there is no {name} '{words[0]}'"
        return ""
    if name in ("test", "python", "mpi"):
        paths = [
            word.split("::")[0] for word in words if word.startswith(("tests/", "tools/", "demos/"))
        ]
        missing = [path for path in paths if not (ROOT / path).exists()]
        return f"there is no {missing[0]}" if missing else ""
    if name in ("lint", "docs", "setup", "shell", "doctor", "--help", "..."):
        return ""
    if name not in COMMANDS:
        return f"there is no command '{name}'"
    try:
        wanted, _ = _parser().parse_known_args(_with_values([name, *words]))
    except SystemExit:
        placeholders = [word for word in words if not is_known(word)]
        # Also an option alone, e.g. of "run --ranks 2".
        is_part = len(words) < 2 or words[0].startswith("--")
        return "" if placeholders or is_part else "its options are wrong"
    scene = getattr(wanted, "scene", None) or getattr(wanted, "design", None)
    if scene is not None and str(scene).startswith("demos/"):
        if not (ROOT / scene).is_file():
            return f"there is no {scene}"
        given = [*(wanted.options or []), *(getattr(wanted, "over", None) or [])]
        names = arguments_of_build(ROOT / scene)
        unknown = [one for one in given if names and one.split("=")[0] not in names]
        if unknown:
            return f"build takes no '{unknown[0]}'"
    return ""


def test_all_pages_are_read() -> None:
    """The blocks and sentences of the first pages, in their order."""
    assert commands_of(ROOT / "docs/first_steps.md")[:3] == [
        "demo pillow",
        "run demos/inflatables/pillow.py cells=12 --output out/pillow_12",
        "plot out/pillow_12",
    ]
    assert len(list(all_commands())) > 150


@pytest.mark.parametrize(("page", "command"), list(all_commands()))
def test_a_command_of_a_page_is_right(
    page: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not what_is_wrong(command), capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("demo pilow", "no demo 'pilow'"),
        ("run demos/inflatables/pillow.py cell=12", "takes no 'cell=12'"),
        ("test tests/none.py", "no tests/none.py"),
        ("plot out/pillow --strip none", "options are wrong"),
        ("launch out", "no command 'launch'"),
    ],
)
def test_a_wrong_command_would_be_found(command: str, said: str) -> None:
    assert said in what_is_wrong(command)


# ---- in order, in a clean folder -----------------------------------------------------------------


def guide_steps(is_slow: bool) -> Iterator[tuple[Path, str]]:
    """Page and command of the guides, in order, those that take seconds or the others."""
    for page in GUIDES:
        for command in commands_of(page):
            words = shlex.split(command)
            is_run = words[:1] and words[0] in COMMANDS and all(map(is_known, words))
            # Without arguments these have nothing to run.
            is_run = is_run and (len(words) > 1 or words[0] in ("doctor", "--help", "demo"))
            takes_long = words[:1] == ["demo"] and command not in QUICK
            takes_long |= words[:1] == ["run"] and command not in QUICK and words[1:2] != []
            takes_long &= not any(word.endswith("pulled.py") for word in words)
            if is_run and takes_long == is_slow:
                yield page, command


def provide_scene(page: Path, command: str, folder: Path) -> None:
    """Write the scene of a page to the file that a command names, as its reader does."""
    for word in shlex.split(command):
        path = folder / word
        if not word.endswith(".py") or path.exists() or word.startswith("demos/"):
            continue
        text = page.read_text(encoding="utf-8")
        scenes = [block[2] for block in BLOCK.finditer(text) if block[1] == "python"]
        [scene] = [one for one in scenes if re.search(r"^def build\(", one, re.MULTILINE)]
        path.write_text(scene, encoding="utf-8")


def run_command(command: str, folder: Path) -> str:
    """Run a command of a guide as a reader would; returns what it prints."""
    words = shlex.split(QUICK.get(command, command))
    environment = os.environ | {"PYTHONPATH": str(ROOT), "BROWSER": "true"}
    if words[0] == "watch":
        program = subprocess.Popen(
            [sys.executable, "-P", "-m", "gossamer_fx", *words],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert program.stdout is not None
        line = program.stdout.readline()
        address = re.search(r"http\S+", line)
        assert address is not None, line
        with urlopen(address[0]) as page:
            assert b"<canvas" in page.read()
        status = ""
        # A scene is computed to its end, so that later commands find its run.
        while not status.startswith("finished") and program.poll() is None:
            with urlopen(f"{address[0]}progress") as answer:
                status = json.loads(answer.read())["status"]
            time.sleep(0.1)
        program.send_signal(signal.SIGINT)
        program.wait(HANG_TIMEOUT)
        return line
    done = subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def run_in_order(steps: Iterator[tuple[Path, str]], folder: Path) -> list[str]:
    """Run commands one after the other, each once, in a folder that has what a clone has."""
    for name in ("demos", "tests", "tools", "gossamer_fx"):
        (folder / name).symlink_to(ROOT / name)
    done: list[str] = []
    for page, command in steps:
        if command in done:
            continue
        provide_scene(page, command, folder)
        run_command(command, folder)
        done.append(command)
    return done


alone = pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="commands start programs",
)


@alone
def test_the_commands_of_the_guides_run_in_order(tmp_path: Path) -> None:
    """Each finds what the ones before it have left."""
    done = run_in_order(guide_steps(is_slow=False), tmp_path)
    assert "report out/pillow_12" in done and "export out/exported" in done


@alone
@pytest.mark.slow
def test_the_long_commands_of_the_guides_run(tmp_path: Path) -> None:
    """Demos of the tutorials, and runs without quick arguments, which are only compiled."""

    def steps() -> Iterator[tuple[Path, str]]:
        for page, command in guide_steps(is_slow=True):
            is_run = command.startswith("run ")
            yield page, f"{command} --dry-run" if is_run else command

    assert run_in_order(steps(), tmp_path)

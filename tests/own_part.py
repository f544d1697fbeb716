"""What the tutorial on own parts defines, section by section."""

from __future__ import annotations

import re
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

PAGE = Path(__file__).parents[1] / "docs" / "tutorials" / "own_part.md"


def code_of(section: str) -> str:
    """The Python code of a section, by its heading."""
    text = PAGE.read_text(encoding="utf-8").split(f"## {section}\n")[1].split("\n## ")[0]
    [code] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    return str(code)


@cache
def module_of(section: str) -> ModuleType:
    """A module with what the code of a section defines, which is run once."""
    name = section.lower().replace(" ", "_")
    module = ModuleType(name)
    # Annotations are looked up in the module of a class, which has no file, as in a notebook.
    sys.modules[name] = module
    exec(compile(code_of(section), name, "exec"), module.__dict__)
    return module

"""How the command starts: as a script, as `python -m uwcoop`, and completed by the shell."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import uwcoop

SCRIPT = Path(sys.executable).parent / "uwcoop"


def started(*command: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command], env=os.environ | environment, capture_output=True, text=True,
        check=False, timeout=120,
    )  # fmt: skip


def test_the_module_is_the_command() -> None:
    version = started(sys.executable, "-m", "uwcoop", "--version")
    assert (version.returncode, version.stdout.strip()) == (0, f"uwcoop {uwcoop.__version__}")
    assert started(SCRIPT, "--version").stdout == version.stdout
    refused = started(sys.executable, "-m", "uwcoop", "run", "no-such-mission")
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: ")
    assert "Traceback" not in refused.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_completion_script(shell: str) -> None:
    script = started(SCRIPT, _UWCOOP_COMPLETE=f"source_{shell}")
    assert script.returncode == 0
    assert f"complete_{shell}" in script.stdout


@pytest.mark.parametrize(("typed", "offered"), [("uwcoop stu", "study"), ("uwcoop run --nav", "--navigator")])
def test_the_shell_completes_commands_and_options(typed: str, offered: str) -> None:
    words = str(len(typed.split()) - 1)
    found = started(SCRIPT, _UWCOOP_COMPLETE="complete_bash", COMP_WORDS=typed, COMP_CWORD=words)
    assert found.returncode == 0
    assert offered in found.stdout.split()

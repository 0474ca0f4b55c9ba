"""Output to the user: results on stdout, everything else on stderr, errors in one line."""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from rich.console import Console

    from uwcoop.experiment.run import RunResult
    from uwcoop.missionlog import MissionLog


USAGE_ERROR: type[Any] = typer.BadParameter.__bases__[0]
"""click's `UsageError`, which some versions of typer bring along themselves."""


class OneLineErrors(TyperGroup):
    """Bad input and usage give one line on stderr and exit code 2, SIGINT one line and 130, SIGTERM one line and 143;
    unexpected errors keep their traceback."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        try:
            return super().make_context(*args, **kwargs)
        except USAGE_ERROR as error:
            fail_usage(error)

    def invoke(self, ctx: Any) -> Any:
        from uwcoop.errors import UwcoopError
        from uwcoop.report.interruption import Interrupted, caught

        try:
            with caught(), warnings.catch_warnings():
                warnings.showwarning = _note
                return super().invoke(ctx)
        except BrokenPipeError:
            raise  # `uwcoop … | head` is no error: click ends quietly
        except UwcoopError as error:
            fail(str(error))
        except USAGE_ERROR as error:
            fail_usage(error)
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            fail(f"{where}{error.strerror or error}")
        except KeyboardInterrupt as stop:
            number = stop.number if isinstance(stop, Interrupted) else signal.SIGINT
            say("terminated" if number == signal.SIGTERM else "interrupted")
            raise typer.Exit(128 + number) from None


def _note(message: Warning | str, *_: Any, **__: Any) -> None:
    say(f"note: {' '.join(str(message).split())}")


def names_of(listed: str | None) -> list[str] | None:
    """The names of a list with commas; None where there is no list."""
    return None if listed is None else [name.strip() for name in listed.split(",")]


def say(line: str) -> None:
    """Print one line on stderr; stdout holds the results only."""
    print(line, file=sys.stderr)


def fail(message: str) -> NoReturn:
    """End the command with one line on stderr and exit code 2."""
    say(f"error: {' '.join(message.split())}")
    raise typer.Exit(2)


def fail_usage(error: Any) -> NoReturn:
    """End the command with one line on stderr that says what was wrong with its arguments and where its help is."""
    called: list[str] = []
    context = error.ctx
    while context is not None and context.parent is not None:
        called.insert(0, context.info_name)
        context = context.parent
    path = " ".join(["uwcoop", *called])
    fail(f"{error.format_message().rstrip('.')}: `{path} --help` shows its use")


def needs_folder(wanted: bool, folder: Path | None, option: str) -> None:
    """Refuse an option that has no meaning without a folder."""
    if wanted and folder is None:
        raise typer.BadParameter("needs the folder of the results: -o DIR", param_hint=option)


def say_written(files: Sequence[str], folder: Path) -> None:
    """Which files are in a folder now."""
    say(f"wrote {folder}: {', '.join(files)}")


def terminal(*, err: bool = False) -> Console:
    """A console on stdout or stderr as they are now."""
    from rich.console import Console

    return Console(stderr=err, highlight=False)


def show(shown: Any, console: Console) -> None:
    """Print a table or a group of tables whole: where the terminal is too narrow for its numbers, the lines are longer
    than the terminal, and no digit is lost."""
    from rich.measure import Measurement

    needed = Measurement.get(console, console.options.update(width=10_000), shown).minimum
    console.width = max(console.width, needed)
    console.print(shown)


def print_run(result: RunResult, console: Console) -> None:
    """The table of a run, against truth as far as it is known and else without it; below it what does not fit, what each
    navigator has no use for, and what is not known."""
    from uwcoop.evaluation.consistency_without_truth import has_truth
    from uwcoop.navigators import not_realisable
    from uwcoop.report.misfit_lines import misfit_lines
    from uwcoop.report.result_tables import summary_table, unused_lines
    from uwcoop.report.truthless_table import truthless_lines, truthless_table

    summary = result.summary
    marked, settle_s = not_realisable(summary["navigators"]), float(result.recorded.attrs["settle_s"])
    known = has_truth(result.recorded)
    lasts = float(result.recorded["time"].values[-1]) > settle_s
    alone = lasts and not known.all()
    if known.any() or not lasts:
        show(summary_table(summary, settle_s=settle_s, not_realisable=marked), console)
    if alone or result.held_out:
        show(truthless_table(summary, settle_s=settle_s, not_realisable=marked), console)
    unknown = [name for name, has in zip(result.log.vehicles, known, strict=True) if not has and alone]
    missing = truthless_lines(summary, unknown) if alone else []
    for line in (*missing, *unused_lines(summary), *misfit_lines(result)):
        console.print(line)


def print_notes(log: MissionLog) -> None:
    """Print what was assumed while the chart was read and the log was made."""
    for note in () if log.chart is None else log.chart.notes:
        say(f"chart: {note}")
    for note in log.notes:
        say(f"note: {note}")


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Callable[..., None]]:
    """A bar with the time left, on stderr, while the block runs.

    It is moved by `step(text)`, or set by `step(text, done, total)`.
    """
    from rich import progress as bars

    columns = (
        bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(),
        bars.TimeElapsedColumn(), bars.TextColumn("left"), bars.TimeRemainingColumn(),
    )  # fmt: skip
    console = terminal(err=True)
    with bars.Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=total)

        def step(text: str, done: int | None = None, of: int | None = None) -> None:
            bar.update(task, description=text, advance=1 if done is None else None, completed=done, total=of)

        yield step

"""The package's errors: every message names the quantity, the value and the bound.

All bad input derives from `ValueError`; the command line turns any `UwcoopError` into one line and exit code 2.
"""

from __future__ import annotations


class UwcoopError(Exception):
    """Base of every error that this package raises on purpose."""


class ScenarioError(UwcoopError, ValueError):
    """A scenario that cannot be what its author meant: unknown key, impossible value, missing file."""


class ScheduleError(ScenarioError):
    """An acoustic schedule that does not fit its modem; the message shows the arithmetic."""


class ChartError(UwcoopError, ValueError):
    """A chart file that cannot be read as a chart: missing, empty, all holes, unknown projection or unit."""


class TableError(UwcoopError, ValueError):
    """A text table that cannot be read: encoding, separator, column, cell or time; its callers raise their own."""


class OutsideChartError(UwcoopError, ValueError):
    """A position or depth that the chart does not hold where one was required."""


class LogError(UwcoopError, ValueError):
    """A mission log that is cut off, out of order, holds NaN, or belongs to another chart."""


class NavigatorError(UwcoopError, ValueError):
    """A navigator option, event or packet that is outside its bound."""


class StudyError(UwcoopError, ValueError):
    """A study that cannot be started or continued: another study's folder, damaged rows, a worker that died."""


class TracksError(UwcoopError, ValueError):
    """Tracks that lack, or a request on them that does not allow, what a metric, figure or replay needs."""


class NumericalError(UwcoopError, ArithmeticError):
    """A factorisation or an inversion that failed."""


class MissingDependencyError(UwcoopError, ImportError):
    """An optional dependency is not installed; the message says which extra brings it."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f'{package} is not installed: pip install "uwcoop[{extra}]"')
        self._made_of = package, extra

    def __reduce__(self) -> tuple[type[MissingDependencyError], tuple[str, str]]:
        # Exceptions are pickled by their message; this one comes back from a study's workers by its parts.
        return type(self), self._made_of

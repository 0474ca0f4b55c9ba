"""The command line: each command is a few lines that call one function. Imports wait until a command runs."""

from uwcoop.cli.commands import app

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the `uwcoop` command."""
    app()

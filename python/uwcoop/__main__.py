"""`python -m uwcoop` is the command `uwcoop`."""

from uwcoop.cli import main

main()

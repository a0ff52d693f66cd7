"""The command line: verbs, and exit codes 0, 1 (it failed) or 2 (you asked for something wrong)."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Annotated

import typer

from posecast.cli import data_commands, export_commands, model_commands, score_commands
from posecast.errors import PosecastError
from posecast.version import __version__

app = typer.Typer(
    name="posecast",
    help="Modelling human motion: read motion capture, forecast the next poses, compare systems.",
    epilog="Example: posecast demo",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool | None) -> None:
    if wanted:
        typer.echo(f"posecast {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool | None,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Say which version."
        ),
    ] = None,
) -> None:
    """Modelling human motion: read motion capture, forecast the next poses, compare systems."""


for verbs in (model_commands, score_commands, export_commands, data_commands):
    verbs.register(app)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; what a user can mend is one line on standard error and exit code 2."""
    with ExitStack() as stack:
        if threading.current_thread() is threading.main_thread():
            # As Ctrl-C does: what is half written is removed on the way out.
            before = signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
            stack.callback(signal.signal, signal.SIGTERM, before)
        _run(arguments)


def _run(arguments: Sequence[str] | None) -> None:
    """Run the command line, whatever becomes of the process."""
    try:
        app(args=None if arguments is None else list(arguments), prog_name="posecast")
    except PosecastError as error:
        sys.stderr.write(f"posecast: {error}\n")
        sys.exit(2)
    except BrokenPipeError:
        # The reader of our output is gone (as in `posecast ... | head`): nothing left to say to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except MemoryError:
        sys.stderr.write("posecast: there is not enough memory for this; try a shorter clip\n")
        sys.exit(1)
    except OSError as error:
        # What the system refuses where no reader or writer was asked: a closed folder, a full disk.
        where = "" if error.filename is None else f"{error.filename}: "
        reason = error.strerror or error
        sys.stderr.write(f"posecast: {where}{reason}; check the path and what you may do there\n")
        sys.exit(2)


if __name__ == "__main__":
    main()

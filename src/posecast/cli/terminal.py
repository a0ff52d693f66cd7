"""What commands share: JSON on standard output, progress on standard error, option texts."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from posecast.errors import ConfigError

if TYPE_CHECKING:
    from posecast.motion.corpus import Corpus
    from posecast.recipe import Recipe

GENERATED = "synthetic"
"""The corpus that is read from no folder."""

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object and nothing else, for programs.")
]
Overrides = Annotated[
    list[str] | None, typer.Argument(help="key.path=value, such as training.epochs=100")
]

CorpusOption = Annotated[
    str | None,
    typer.Option("--corpus", help="Named corpus: synthetic, cmu-salsa, h36m, folder, ..."),
]
FpsOption = Annotated[
    float | None,
    typer.Option("--fps", help="True frame rate of the input, where its header is wrong."),
]
UnitOption = Annotated[
    float | None,
    typer.Option("--unit", help="BVH: metres per file unit, such as 0.01; else it is guessed."),
]
UpOption = Annotated[
    str | None, typer.Option("--up", help="BVH: the vertical axis, x, y or z; else it is guessed.")
]
SkeletonOption = Annotated[
    Path | None,
    typer.Option("--skeleton", help="AMC: the actor's .asf; else the one beside it is taken."),
]
TemplateOption = Annotated[
    Path | None,
    typer.Option("--template", help="AMASS: joint positions of the body at rest (.npy, .npz)."),
]
RootOption = Annotated[
    Path | None, typer.Option("--root", help="Folder in which that corpus lies, unpacked.")
]
PinFeetOption = Annotated[
    bool, typer.Option("--pin-feet", help="Hold feet that slide in place while they stand.")
]


def print_json(value: Any) -> None:
    """One JSON value on standard output; numbers that JSON cannot say become null.

    In ASCII: names in any script, and names of files that are no text, come through any terminal.
    """
    sys.stdout.write(json.dumps(_finite(value), indent=1) + "\n")


def say(text: str) -> None:
    """A line for people, on standard error, so that standard output stays for results."""
    sys.stderr.write(text + "\n")


def check_root(kind: str, root: Path | None) -> None:
    """Refuse a folder of recordings that is none; say so where the corpus has no use for one.

    Raises:
        ConfigError: ``root`` is not a folder.
    """
    if root is None:
        return
    if kind == GENERATED:
        say(f"note: corpus {kind!r} is generated; --root {root} is not read")
    elif not root.is_dir():
        raise ConfigError(f"--root {root}: not a folder; give the folder of corpus {kind!r}")


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on standard error while a long job runs; silent where there is no terminal.

    Yields:
        A function to call with (done, total).
    """
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _finite(value: Any) -> Any:
    """The same structure with NaN and infinity as null."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def read_corpus(recipe: Recipe, root: Path | None) -> Corpus:
    """A recipe's corpus, with a bar while files are parsed for the first time."""
    kind = str(recipe.config["corpus"]["kind"])
    check_root(kind, root)
    with progress_bar(f"reading {kind}") as advance:
        return recipe.build_corpus(root, progress=advance)

"""Verbs that score systems: evaluate, compare, reproduce, endure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posecast.cli.terminal import (
    CorpusOption,
    JsonOption,
    Overrides,
    RootOption,
    print_json,
    say,
)


def register(app: typer.Typer) -> None:
    """Add this file's verbs to the command line."""
    app.command(
        epilog="Example: posecast evaluate zero-velocity --corpus synthetic --protocol short-term"
    )(evaluate)
    app.command(
        epilog="Example: posecast compare acrnn-quaternion-small acrnn-dual-quaternion-small "
        "--corpus synthetic --seeds 1 training.epochs=2 --out compared"
    )(compare)
    app.command(
        epilog="Example: posecast reproduce iccv2019-6 --small --seeds 1 --root h36m=data/h36m "
        "--rows RNN-SPL --out reproduced"
    )(reproduce)
    app.command(epilog="Example: posecast endure runs/small/best --frames 3000 --out endurance")(
        endure
    )


def evaluate(
    systems: Annotated[
        list[str],
        typer.Argument(
            help="Checkpoint folders or names of posecast models, or zero-velocity, "
            "running-average-2, running-average-4, mean-pose. Several checkpoints are runs of one "
            "system: mean and spread are reported. "
            "And options of corpus and protocol, such as protocol.joints=null, and model.feedback."
        ),
    ],
    corpus: CorpusOption = None,
    root: RootOption = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            "--protocol",
            help="h36m-standard, h36m-128, h36m-long, amass-spl, cmu-acrnn, cross-skeleton or "
            "short-term; locomotion for walks along paths; as the system's recipe says by default.",
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(
            "--split",
            help="Which clips are scored: test by default, validation beside walks along paths.",
        ),
    ] = None,
    as_json: JsonOption = False,
    markdown: Annotated[
        Path | None, typer.Option("--markdown", help="Write the table there, too.")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="Write the rows there, too.")] = None,
) -> None:
    """Score systems under a protocol, beside zero velocity and running averages."""
    from posecast.cli.scoring import score_systems
    from posecast.cli.walk_scoring import score_walkers
    from posecast.evaluation import Report
    from posecast.evaluation.walk_report import WALKS, WalkReport
    from posecast.io.atomic import check_target

    for path in (markdown, csv):
        if path is not None:
            check_target(path)
    report: Report | WalkReport
    if protocol == WALKS:
        report = score_walkers(systems, corpus=corpus, root=root, split=split or "validation")
    else:
        report = score_systems(
            systems, corpus=corpus, root=root, protocol=protocol, split=split or "test"
        )
    try:
        typer.echo(report.to_json() if as_json else report.to_markdown())
    finally:  # whoever read standard output may be gone; the files were asked for all the same
        for path, text in ((markdown, report.to_markdown()), (csv, report.to_csv())):
            if path is not None:
                _write_text(path, text)


def compare(
    recipes: Annotated[
        list[str],
        typer.Argument(
            help="Recipes to compare, and key.path=value, such as training.epochs=100, for all."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder of the runs and the results.")],
    corpus: CorpusOption = None,
    root: RootOption = None,
    protocol: Annotated[
        str | None, typer.Option("--protocol", help="As the first recipe says by default.")
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", help="Runs of each recipe.")] = 3,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Train several systems on equal terms; one table, one convergence plot, one moving picture.

    What is trained already in OUT is not trained again, so the same command goes on.
    """
    from posecast.cli.comparing import compare_systems
    from posecast.training.plan import require_lightning
    from posecast.viewer.canvas import optional

    require_lightning()
    for drawing in ("PIL.Image", "matplotlib.figure"):
        optional(drawing)
    text = compare_systems(
        [each for each in recipes if "=" not in each],
        [each for each in recipes if "=" in each],
        out,
        corpus=corpus,
        root=root,
        protocol=protocol,
        seeds=seeds,
        progress=not quiet,
    )
    typer.echo(text)
    say(f"everything is under {out}/")


def reproduce(
    table: Annotated[
        str | None, typer.Argument(help="A table, such as ijcv2019-2; none: list all of them.")
    ] = None,
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option("--out", help="Folder of the runs and the report.")] = Path(
        "reproduced"
    ),
    rows: Annotated[
        list[str] | None,
        typer.Option("--rows", help="A row, by the paper's name or ours; may be repeated. All."),
    ] = None,
    root: Annotated[
        list[str] | None,
        typer.Option("--root", help="KIND=DIR, folder of a corpus; may be repeated."),
    ] = None,
    corpus: CorpusOption = None,
    seeds: Annotated[int, typer.Option("--seeds", help="Runs of each recipe.")] = 3,
    small: Annotated[
        bool, typer.Option("--small", help="The small forms of the recipes, for two CPU cores.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Train and score what a published table needs, and print its numbers beside ours.

    What is trained already in OUT is not trained again, so the same command goes on. Rows whose
    recordings are not there are named.
    """
    from posecast.cli.reproducing import list_tables, parse_roots, reproduce_table
    from posecast.training.plan import require_lightning

    if table is None:
        typer.echo(list_tables())
        return
    require_lightning()
    text = reproduce_table(
        table,
        rows or (),
        overrides or (),
        out,
        roots=parse_roots(root or ()),
        corpus=corpus,
        seeds=seeds,
        small=small,
        progress=not quiet,
    )
    typer.echo(text)
    say(f"everything is under {out}/")


def endure(
    checkpoint: Annotated[Path, typer.Argument(help="A checkpoint folder.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for tables and pictures.")],
    frames: Annotated[int, typer.Option("--frames", help="Length of the rollouts.")] = 30_000,
    starts: Annotated[int, typer.Option("--starts", help="How many rollouts.")] = 4,
    split: Annotated[
        str, typer.Option("--split", help="Where they begin: test, or validation to choose by.")
    ] = "test",
    corpus: CorpusOption = None,
    root: RootOption = None,
) -> None:
    """Roll a system out for minutes: does it freeze, does it blow up, how fast does it move?"""
    from posecast.cli.enduring import endure as endure_system
    from posecast.viewer.canvas import optional

    for drawing in ("PIL.Image", "matplotlib.figure"):
        optional(drawing)
    facts = endure_system(
        checkpoint, out, frames=frames, starts=starts, split=split, corpus=corpus, root=root
    )
    print_json(facts)


def _write_text(path: Path, text: str) -> None:
    from posecast.io.atomic import atomic_write

    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")

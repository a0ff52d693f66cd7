"""Verbs about systems: demo, recipes, train, evaluate, forecast."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posecast.cli.reading import Reading
from posecast.cli.terminal import (
    CorpusOption,
    FpsOption,
    JsonOption,
    RootOption,
    SkeletonOption,
    TemplateOption,
    UnitOption,
    UpOption,
    print_json,
    read_corpus,
    say,
)
from posecast.config import did_you_mean
from posecast.errors import ConfigError, SkeletonError

Overrides = Annotated[
    list[str] | None, typer.Argument(help="key.path=value, such as training.epochs=100")
]


def register(app: typer.Typer) -> None:
    """Add this file's verbs to the command line."""
    app.command(epilog="Example: posecast demo")(demo)
    app.command(epilog="Example: posecast recipes quaternet-vel")(recipes)
    app.command(epilog="Example: posecast train quaternet-vel-small --out runs/small")(train)
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
    app.command(
        epilog="Example: posecast forecast runs/small/best walk.bvh --horizon-ms 1000 --out out.bvh"
    )(forecast)


def demo(
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for everything it writes.")] = Path(
        "demo"
    ),
) -> None:
    """Train a small model on synthetic motion and show what it can do; minutes on two cores."""
    from posecast.cli.demo import run_demo

    run_demo(out, overrides or ())


def recipes(
    name: Annotated[str | None, typer.Argument(help="Show this one in full.")] = None,
    as_json: JsonOption = False,
) -> None:
    """List the systems that come with posecast: source, size, what to expect."""
    import yaml

    from posecast.recipe import list_recipes, load_recipe

    if name is not None:
        config = dict(load_recipe(name).config)
        if as_json:
            print_json(config)
        else:
            typer.echo(yaml.safe_dump(config, sort_keys=False, allow_unicode=True), nl=False)
        return
    rows = [_recipe_row(each) for each in list_recipes()]
    if as_json:
        print_json(rows)
        return
    for row in rows:
        size = "" if row["parameters"] is None else f" ({row['parameters']:,} parameters)"
        typer.echo(f"{row['name']}: {row['summary']}{size}")
        typer.echo(f"    source: {row['source']}")
        typer.echo(f"    expect: {row['expect']}")


def train(
    recipe: Annotated[str, typer.Argument(help="Name of a recipe, or the path of a YAML file.")],
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option("--out", help="Folder of the run.")] = Path("runs/new"),
    corpus: CorpusOption = None,
    root: RootOption = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run that is in the folder.")
    ] = False,
    accelerator: Annotated[str, typer.Option(help="auto, cpu, gpu, ...")] = "auto",
    devices: Annotated[int | None, typer.Option(help="How many on each machine.")] = None,
    nodes: Annotated[int | None, typer.Option(help="How many machines.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Train a system; writes checkpoints to OUT/last and OUT/best, logs beside them."""
    from posecast.recipe import load_recipe
    from posecast.system import train as train_system
    from posecast.training.plan import Machines, require_lightning

    require_lightning()
    chosen = load_recipe(recipe, overrides or (), corpus=corpus)
    machines = Machines(
        accelerator,
        "auto" if devices is None else devices,
        "auto" if nodes is None else nodes,
    )
    data = read_corpus(chosen, root)
    try:
        result = train_system(
            chosen, data, out, machines=machines, resume=resume, progress=not quiet
        )
    except KeyboardInterrupt:
        say(f"stopped; the same command with --resume goes on from the last state in {out}")
        raise
    if not result.is_main_process:
        return
    for note in data.notes:
        say(f"note: {note}")
    if result.skipped:
        say(f"note: {result.skipped} recordings are shorter than a window and were not used")
    say(f"{result.epochs} epochs, {result.updates} updates: {out / 'last'}")
    if result.best is not None:
        best = result.best
        say(
            f"best validation after epoch {best.epoch}, {best.metric} "
            f"{best.metrics[best.metric]:.4f}: {out / 'best'}"
        )


def evaluate(
    systems: Annotated[
        list[str],
        typer.Argument(
            help="Checkpoint folders, or zero-velocity, running-average-2, running-average-4, "
            "mean-pose. Several checkpoints are runs of one system: mean and spread are reported. "
            "And options of corpus and protocol, such as protocol.joints=null."
        ),
    ],
    corpus: CorpusOption = None,
    root: RootOption = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            "--protocol",
            help="h36m-standard, h36m-128, h36m-long, amass-spl, cmu-acrnn, cross-skeleton or "
            "short-term; as the system's recipe says by default.",
        ),
    ] = None,
    split: Annotated[str, typer.Option("--split", help="Which clips are scored.")] = "test",
    as_json: JsonOption = False,
    markdown: Annotated[
        Path | None, typer.Option("--markdown", help="Write the table there, too.")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="Write the rows there, too.")] = None,
) -> None:
    """Score systems under a protocol, beside zero velocity and running averages."""
    from posecast.cli.scoring import score_systems
    from posecast.io.atomic import check_target

    for path in (markdown, csv):
        if path is not None:
            check_target(path)
    report = score_systems(systems, corpus=corpus, root=root, protocol=protocol, split=split)
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


def forecast(
    checkpoint: Annotated[Path, typer.Argument(help="A checkpoint folder.")],
    clip: Annotated[Path, typer.Argument(help="A motion file with the checkpoint's skeleton.")],
    out: Annotated[Path, typer.Option("--out", help="The BVH, GLB or archive to write.")],
    horizon_ms: Annotated[
        float,
        typer.Option(
            "--horizon-ms",
            max=3_600_000,
            help="How far to look ahead, milliseconds, up to an hour.",
        ),
    ] = 1000,
    fps: FpsOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    skeleton: SkeletonOption = None,
    template: TemplateOption = None,
    mapping: Annotated[
        Path | None,
        typer.Option(
            "--mapping", help="YAML: for joints of the checkpoint their names in the clip."
        ),
    ] = None,
    action: Annotated[
        str | None,
        typer.Option("--action", help="What is done in the clip, for checkpoints that are told."),
    ] = None,
) -> None:
    """Continue a clip: writes the clip and its forecast in the clip's own conventions."""
    from posecast.cli.data_commands import save_clip
    from posecast.cli.reading import read_mapping, with_action
    from posecast.forecast import rename_joints
    from posecast.io.atomic import check_target
    from posecast.system import load

    check_target(out)
    reading = Reading(fps, unit=unit, up=up, skeleton=skeleton, template=template)
    reading.check([clip])
    system = load(checkpoint)
    known = with_action(reading.clip(clip), action, system.forecaster.codec.actions)
    names = {} if mapping is None else read_mapping(mapping)
    for new, old in names.items():
        # One that takes a name of the checkpoint away from another joint may give any.
        if new not in system.skeleton.names and old not in system.skeleton.names:
            raise ConfigError(
                f"{mapping}: {new!r} is no joint of the checkpoint; "
                f"{did_you_mean(new, system.skeleton.names)}"
            )
    try:
        continued = system.forecast(rename_joints(known, names), horizon_ms=horizon_ms)
        continued = rename_joints(continued, {old: new for new, old in names.items()})
    except SkeletonError as error:
        raise SkeletonError(f"{clip}: {error}") from None
    if "rotations" not in system.forecaster.codec.representation.states:
        say(
            "note: the system predicts positions; rotations are fitted, and the twist of each bone "
            "about itself is inferred"
        )
    save_clip(continued, out)
    say(f"{out} written: the forecast begins after {known.frames} frames")


def _recipe_row(name: str) -> dict[str, str | int | None]:
    """One line of the list; parameters are counted on the skeleton the paper used."""
    from posecast.recipe import count_parameters, load_recipe

    recipe = load_recipe(name)
    return {
        "name": name,
        **{text: str(recipe.config[text]) for text in ("summary", "source", "expect")},
        "corpus": str(recipe.config["corpus"]["kind"]),
        "protocol": str(recipe.config["protocol"]["kind"]),
        "parameters": count_parameters(recipe),
    }


def _write_text(path: Path, text: str) -> None:
    from posecast.io.atomic import atomic_write

    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")

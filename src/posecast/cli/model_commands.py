"""Verbs about systems: demo, recipes, train, forecast, walk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posecast.cli.reading import Reading
from posecast.cli.terminal import (
    CorpusOption,
    FpsOption,
    JsonOption,
    Overrides,
    PinFeetOption,
    RootOption,
    SkeletonOption,
    TemplateOption,
    UnitOption,
    UpOption,
    print_json,
    progress_bar,
    read_corpus,
    say,
)
from posecast.config import did_you_mean
from posecast.errors import ConfigError, SkeletonError


def register(app: typer.Typer) -> None:
    """Add this file's verbs to the command line."""
    app.command(epilog="Example: posecast demo")(demo)
    app.command(epilog="Example: posecast recipes quaternet-vel")(recipes)
    app.command(epilog="Example: posecast train quaternet-vel-small --out runs/small")(train)
    app.command(
        epilog="Example: posecast forecast runs/small/best walk.bvh --horizon-ms 1000 --out out.bvh"
    )(forecast)
    app.command(
        epilog="Example: posecast walk runs/locomotion/best --path eight.csv --speed 1.2 "
        "--out walk.bvh"
    )(walk)


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
    start: Annotated[
        Path | None,
        typer.Option("--start", help="A checkpoint of the same network: begin with its weights."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run that is in the folder.")
    ] = False,
    accelerator: Annotated[str, typer.Option(help="auto, cpu, gpu, ...")] = "auto",
    devices: Annotated[int | None, typer.Option(help="How many on each machine.")] = None,
    nodes: Annotated[int | None, typer.Option(help="How many machines.")] = None,
    cuda_graphs: Annotated[
        bool,
        typer.Option(
            "--cuda-graphs", help="Record a step and replay it: faster on one NVIDIA GPU."
        ),
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Train a system; writes checkpoints to OUT/last and OUT/best, logs beside them."""
    from posecast.recipe import load_recipe
    from posecast.system import load
    from posecast.system import train as train_system
    from posecast.training.plan import Machines, require_lightning

    require_lightning()
    chosen = load_recipe(recipe, overrides or (), corpus=corpus)
    machines = Machines(
        accelerator,
        "auto" if devices is None else devices,
        "auto" if nodes is None else nodes,
        cuda_graphs=cuda_graphs,
    )
    begin = None if start is None else load(start)
    data = read_corpus(chosen, root)
    try:
        result = train_system(
            chosen,
            data,
            out,
            start=begin,
            machines=machines,
            resume=resume,
            progress=not quiet,
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


def walk(
    checkpoint: Annotated[
        Path, typer.Argument(help="A checkpoint folder that walks, or a name of posecast models.")
    ],
    path: Annotated[Path, typer.Option("--path", help="The path: .csv, .json or .svg.")],
    out: Annotated[
        Path, typer.Option("--out", help="What to write: .bvh, .glb, .npz, or .gif and .mp4.")
    ],
    speed: Annotated[
        float | None, typer.Option("--speed", help="m/s where it is straight.")
    ] = None,
    arrive: Annotated[
        list[str] | None,
        typer.Option("--arrive", help="SECONDS@POINT: be at that way point then; may be repeated."),
    ] = None,
    facing: Annotated[
        float | None, typer.Option("--facing", help="Degrees to the left of the path's direction.")
    ] = None,
    style: Annotated[
        str | None, typer.Option("--style", help="Of those it was trained on.")
    ] = None,
    mode: Annotated[
        str,
        typer.Option("--mode", help="exact, or fast: large weights in eight bits (extra onnx)."),
    ] = "exact",
    seconds: Annotated[
        float | None,
        typer.Option(
            "--seconds", min=0.1, max=36_000, help="How long; to the path's end by default."
        ),
    ] = None,
    pinned: PinFeetOption = False,
) -> None:
    """Walk along a drawn path."""
    from posecast.cli.data_commands import save_clip
    from posecast.cli.walking import Wishes, walk_along
    from posecast.io.atomic import check_target
    from posecast.motion import pin_feet
    from posecast.system import load

    check_target(out)
    wishes = Wishes(speed, arrive or (), facing, style, seconds, mode)
    clip, course = walk_along(load(checkpoint), path, wishes)
    if pinned:
        clip, report = pin_feet(clip)
        say(report.text())
    if out.suffix.lower() in (".gif", ".mp4", ".png"):
        from posecast.viewer import draw

        with progress_bar("drawing") as advance:
            draw([clip], out, titles=[path.stem], progress=advance)
    else:
        save_clip(clip, out)
    say(f"{out} written: {clip.duration:.1f} s along {course.path.length:.1f} m")


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

"""Verbs that hand systems over: models that come with posecast, and export to other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from posecast.cli.terminal import JsonOption, print_json, say
from posecast.config import did_you_mean
from posecast.errors import ConfigError


def register(app: typer.Typer) -> None:
    """Add this file's verbs to the command line."""
    app.command(epilog="Example: posecast models locomotion")(models)
    app.command(epilog="Example: posecast export runs/small/best --out step.onnx")(export)


def models(
    name: Annotated[str | None, typer.Argument(help="Show this model's card.")] = None,
    as_json: JsonOption = False,
) -> None:
    """List the trained systems that come with posecast: what they do, their data and licence."""
    from posecast.shipped import shipped_models

    found = shipped_models()
    if name is not None:
        chosen = [model for model in found if model.name == name]
        if not chosen:
            names = [model.name for model in found]
            raise ConfigError(f"no model {name!r} comes with posecast; {did_you_mean(name, names)}")
        typer.echo(chosen[0].card, nl=False)
        return
    if as_json:
        print_json([{**model._asdict(), "folder": str(model.folder)} for model in found])
        return
    for model in found:
        typer.echo(f"{model.name}: {model.summary} ({model.megabytes:.1f} MB)")
        typer.echo(f"    data: {model.data}")
        typer.echo(f"    licence: {model.license}")


def export(
    checkpoint: Annotated[Path, typer.Argument(help="A checkpoint folder.")],
    out: Annotated[
        Path, typer.Option("--out", help="The ONNX file to write; with --half, a folder.")
    ],
    mode: Annotated[
        str,
        typer.Option(
            "--mode",
            help="exact, or fast: large weights in eight bits, which ONNX Runtime alone can read.",
        ),
    ] = "exact",
    half: Annotated[
        bool,
        typer.Option("--half", help="Write no ONNX but the checkpoint, weights in half precision."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write one step of a system as ONNX, for C++, C# or a robot; its record is beside it."""
    from posecast.checkpoint import WEIGHTS
    from posecast.export import export_step, record_of
    from posecast.export.extra import require_extra
    from posecast.export.stepper import check_mode
    from posecast.system import load, save

    if half:
        if mode != "exact" or as_json:
            raise ConfigError("--half writes a checkpoint and no step; leave --mode and --json out")
        save(load(checkpoint), out, half=True)
        say(f"{out} written: {(out / WEIGHTS).stat().st_size / 1e6:.1f} MB of weights")
        return
    check_mode(mode)
    require_extra()
    system = load(checkpoint)
    parity = export_step(
        system.forecaster,
        out,
        offsets=system.offsets,
        fps=system.fps,
        mode=cast("Any", mode),
    )
    if as_json:
        print_json({"step": str(out), "record": str(record_of(out)), "parity": parity.record()})
        return
    largest = max(parity.differences.values())
    batches = ", ".join(map(str, parity.differences))
    say(
        f"{out} written: {system.parameters:,} weights, {out.stat().st_size / 1e6:.1f} MB; "
        f"differs from the network by {largest:.1e} at most, over {parity.steps} steps at batch "
        f"sizes {batches}"
    )
    say(f"{record_of(out)} says what its numbers are")

"""The verb that hands a system over to other programs: export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from posecast.cli.terminal import JsonOption, print_json, say


def register(app: typer.Typer) -> None:
    """Add this file's verb to the command line."""
    app.command(epilog="Example: posecast export runs/small/best --out step.onnx")(export)


def export(
    checkpoint: Annotated[Path, typer.Argument(help="A checkpoint folder.")],
    out: Annotated[Path, typer.Option("--out", help="The ONNX file to write.")],
    mode: Annotated[
        str,
        typer.Option(
            "--mode",
            help="exact, or fast: large weights in eight bits, which ONNX Runtime alone can read.",
        ),
    ] = "exact",
    as_json: JsonOption = False,
) -> None:
    """Write one step of a system as ONNX, for C++, C# or a robot; its record is beside it."""
    from posecast.export import export_step, record_of
    from posecast.export.extra import require_extra
    from posecast.export.stepper import check_mode
    from posecast.system import load

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

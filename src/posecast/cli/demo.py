"""``posecast demo``: from nothing to a trained forecaster, a table and pictures, in minutes."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import typer

from posecast.cli.terminal import progress_bar, say
from posecast.errors import ConfigError
from posecast.evaluation import AVERAGE, BASELINES, Report, build_protocol, evaluate
from posecast.io import write_clip
from posecast.io.atomic import atomic_write
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.recipe import load_recipe
from posecast.system import System, load, train
from posecast.training.keeping import RUN_FILES
from posecast.training.plan import require_lightning
from posecast.viewer.canvas import optional

RECIPE = "quaternet-vel-small"
SHORTER = ("training.epochs=36",)
"""Enough for a demonstration on synthetic motion; the recipe itself takes more."""

CURVE_MS = tuple(range(40, 1001, 40))
PREFIX_MS, HORIZON_MS = 2000, 1000


def run_demo(folder: Path, overrides: Sequence[str] = ()) -> None:
    """Train the small system on synthetic motion and write everything to ``folder``.

    Args:
        folder: made if it is not there; files of an earlier demo are replaced.
        overrides: of the recipe, such as ``training.epochs=1``.

    Raises:
        DataError: the folder cannot be written.
        ConfigError: an override that does not fit, or Lightning or Matplotlib is not installed, or
            ``folder/run`` has something in it that no demo wrote.
    """
    require_lightning()
    for drawing in ("PIL.Image", "matplotlib.figure"):
        optional(drawing)
    began = time.monotonic()
    recipe = load_recipe(RECIPE, (*SHORTER, *overrides))
    folder.mkdir(parents=True, exist_ok=True)
    run = folder / "run"
    _clear(run)
    say("1/4 making the synthetic corpus")
    with progress_bar("clips") as advance:
        corpus = recipe.build_corpus(progress=advance)
    say(f"2/4 training {RECIPE} for {recipe.plan.epochs} epochs")
    train(recipe, corpus, run)
    system = load(run / "best")
    say("3/4 scoring it on held-out clips, beside zero velocity and running averages")
    report = evaluate(system.predictor, recipe.protocol, corpus, system=RECIPE)
    for name, text in (
        ("results.md", report.to_markdown()),
        ("results.csv", report.to_csv()),
        ("results.json", report.to_json() + "\n"),
    ):
        with atomic_write(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    say("4/4 writing a forecast and pictures")
    _draw_curves(system, corpus, folder / "error_over_horizon.png")
    _draw_forecast(system, corpus, folder)
    typer.echo(report.to_markdown())
    typer.echo(_summary(report))
    say(f"{time.monotonic() - began:.0f} s; everything is under {folder}/")


def _clear(run: Path) -> None:
    """Remove the run of an earlier demo, if it is nothing but that."""
    if not run.exists():
        return
    own = {*RUN_FILES, "tensorboard", *(f"{name}.previous" for name in RUN_FILES)}
    # Names with a dot in front are half-written files of a demo that was killed, or a system's.
    names = sorted(entry.name for entry in run.iterdir())
    foreign = [name for name in names if name not in own and not name.startswith(".")]
    if foreign:
        raise ConfigError(
            f"{run} holds {foreign[0]!r}, which no demo wrote; move it away, or name another "
            "folder with --out"
        )
    shutil.rmtree(run)


def _summary(report: Report) -> str:
    """How far below zero velocity the system is, horizon by horizon."""
    metric = report.runs[0].metrics[0]
    lines = [line for line in report.lines if (line.action, line.metric) == (AVERAGE, metric)]
    still = {
        line.horizon_ms: line.value
        for line in report.baseline_lines
        if (line.system, line.action, line.metric) == ("zero-velocity", AVERAGE, metric)
    }
    gains = ", ".join(
        f"{100 * (1 - line.value / still[line.horizon_ms]):.0f} % at {line.horizon_ms:g} ms"
        for line in lines
    )
    return f"Error below zero velocity ({metric}): {gains}"


def _draw_curves(system: System, corpus: Corpus, path: Path) -> None:
    """Error over the horizon, the system beside the baselines."""
    from posecast.viewer.plots import error_over_horizon

    protocol = build_protocol("short-term", horizons_ms=list(CURVE_MS), metrics=["joint_angle"])
    predictors = {RECIPE: system.predictor, **BASELINES}
    curves = {
        name: [
            (row.horizon_ms, row.value)
            for row in protocol.score(predictor, corpus, system=name).rows
            if row.action == AVERAGE
        ]
        for name, predictor in predictors.items()
    }
    error_over_horizon(curves, path, metric="joint_angle")


def _draw_forecast(system: System, corpus: Corpus, folder: Path) -> None:
    """A held-out clip and what the system made of its beginning: BVH files and a moving picture."""
    from posecast.viewer import draw

    truth, prefix = _example(corpus)
    forecast = system.forecast(truth.cut(0, prefix), horizon_ms=HORIZON_MS)
    forecast = replace(forecast, name="forecast")
    write_clip(forecast, folder / "forecast.bvh")
    write_clip(truth, folder / "truth.bvh")
    draw(
        [truth, forecast],
        folder / "forecast.gif",
        titles=["truth", "forecast"],
        split_frame=prefix,
    )


def _example(corpus: Corpus) -> tuple[Clip, int]:
    """The piece of a test clip that travels as far as is usual, and its number of known frames."""
    prefix, horizon = (round(ms * corpus.fps / 1000) for ms in (PREFIX_MS, HORIZON_MS))
    pieces = [
        clip.cut(start, start + prefix + horizon)
        for clip in corpus.split("test")
        for start in range(0, clip.frames - prefix - horizon + 1, prefix)
    ]
    travelled = [
        float((piece.root_positions[-1] - piece.root_positions[prefix]).norm()) for piece in pieces
    ]
    median = sorted(travelled)[len(travelled) // 2]
    return pieces[travelled.index(median)], prefix

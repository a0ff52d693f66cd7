"""What ``posecast endure`` does: a rollout of minutes, second by second beside the training set."""

from __future__ import annotations

import csv
import json
import statistics
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.cli.scoring import check_skeleton, corpus_of
from posecast.cli.terminal import progress_bar, say
from posecast.errors import ConfigError
from posecast.evaluation import Scene
from posecast.evaluation.freeze import FreezeDetector, Liveliness
from posecast.evaluation.motion_metrics import bone_length_drift
from posecast.io.atomic import atomic_write
from posecast.model import Session
from posecast.motion import Clip, Motion
from posecast.motion.corpus import Corpus
from posecast.system import System, load

PIECE = 300  # frames that are decoded and looked at together
SHOWN, SHOWN_S = 4, 4.0  # rollouts, and seconds at their ends, that are drawn


def endure(
    checkpoint: Path,
    out: Path,
    *,
    frames: int,
    starts: int,
    split: str,
    corpus: str | None,
    root: Path | None,
) -> dict[str, Any]:
    """Roll a system out from several places of a split and see whether it keeps moving.

    Args:
        checkpoint: a folder.
        out: folder for ``endurance.csv``, ``endurance.json``, ``endurance.png`` and ``end.png``.
        frames: length of the rollouts.
        starts: how many rollouts, beginning at windows spread evenly over the split.
        split: ``test``, or ``validation`` to choose among checkpoints.
        corpus: kind of corpus; ``None``: the one the system was trained on.
        root: folder of the corpus.

    Raises:
        ConfigError: a number out of its range, or no clip of the split as long as the prefix.
    """
    if frames < 1 or starts < 1:
        raise ConfigError(f"--frames {frames}, --starts {starts}: expected 1 or more of each")
    system = load(checkpoint)
    data = corpus_of(system, corpus, root)
    check_skeleton(system, data)
    detector = FreezeDetector.of(data.split("train"))
    known = _starts(system, data, split, starts)
    out.mkdir(parents=True, exist_ok=True)
    kept: deque[Motion] = deque(maxlen=3)
    scene = Scene(data.skeleton, data.fps, known)
    drift: list[float] = []
    travelled: list[Tensor] = [known.root_positions[:, -1]]
    with progress_bar("frames") as advance:

        def pieces() -> Iterator[Motion]:
            done = 0
            for piece in _roll_out(system, known, frames):
                done += piece.root_positions.shape[1]
                advance(done, frames)
                drift.append(float(bone_length_drift(piece, piece, scene).mean()))
                travelled.append(piece.root_positions[:, -1])
                kept.append(piece)
                yield piece

        found = detector.examine(pieces())
    facts = {
        "system": system.recipe.name,
        "corpus": data.name,
        "split": split,
        "frames": frames,
        "rollouts": len(known.root_positions),
        "seconds": found.speed.shape[1],
        "moving_at_the_end": _moving_at_the_end(found),
        "frozen_share": found.frozen_share.mean().item(),
        "blown_share": found.blown_share.mean().item(),
        "speed_ratio_first_minute": found.speed_ratio[:, :60].mean().item(),
        "speed_ratio_last_minute": found.speed_ratio[:, -60:].mean().item(),
        "spectral_distance_first_minute_hz": found.spectral_distance[:, :60].mean().item(),
        "spectral_distance_last_minute_hz": found.spectral_distance[:, -60:].mean().item(),
        "root_drift_mps": _drift(travelled[-1] - travelled[0], frames / data.fps),
        "training_root_drift_mps": statistics.fmean(
            _drift(clip.root_positions[-1:] - clip.root_positions[:1], clip.frames / clip.fps)
            for clip in data.split("train")
        ),
        "bone_length_error_first_mm": 1000 * drift[0],
        "bone_length_error_last_mm": 1000 * drift[-1],
    }
    with atomic_write(out / "endurance.json") as temporary:
        temporary.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    _write_rows(found, out / "endurance.csv")
    _draw(found, detector, kept, data.clips[0], system.recipe.name, out)
    return facts


def _starts(system: System, data: Corpus, split: str, starts: int) -> Motion:
    """Prefixes spread evenly over a split."""
    prefix = system.recipe.protocol.frames(system.fps).prefix
    windows = data.windows(split, prefix)
    if not len(windows):
        raise ConfigError(
            f"no clip of split {split!r} of {data.name!r} has the {prefix} frames of a prefix; "
            "begin in another one (--split)"
        )
    places = [round(k * (len(windows) - 1) / max(starts - 1, 1)) for k in range(starts)]
    return data.gather([windows[place] for place in sorted(set(places))], prefix)


def _roll_out(system: System, known: Motion, frames: int) -> Iterator[Motion]:
    """The frames that follow, in pieces; only one piece is in memory."""
    forecaster = system.forecaster.eval()
    codec, weight = forecaster.codec, next(forecaster.parameters())
    anchor, held = known.root_positions[:, -1], known.rotations_local[:, -1]
    with torch.no_grad():
        session = Session.start(forecaster, codec.encode(known).to(weight))
        for first in range(0, frames, PIECE):
            count = min(PIECE, frames - first)
            features = torch.stack([session.step() for _ in range(count)], dim=1)
            piece = codec.decode(
                features.to(anchor), offsets=known.offsets, anchor=anchor, held=held
            )
            anchor = piece.root_positions[:, -1]
            yield piece


def _drift(moved: Float[Tensor, "batch 3"], seconds: float) -> float:
    """Mean net speed over the floor, metres per second; who comes back has none."""
    return torch.linalg.vector_norm(moved[:, [0, 2]].double(), dim=-1).mean().item() / seconds


def _moving_at_the_end(found: Liveliness) -> int:
    """How many rollouts are neither frozen nor blown in most seconds of their last minute."""
    still = (found.frozen | found.blown)[:, -60:].double().mean(1)
    return int((still < 0.5).sum())


def _write_rows(found: Liveliness, path: Path) -> None:
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["rollout", "second", "speed", "speed_ratio", "spectral_distance_hz"])
        for rollout in range(found.speed.shape[0]):
            for second in range(found.speed.shape[1]):
                values = (
                    part[rollout, second].item()
                    for part in (found.speed, found.speed_ratio, found.spectral_distance)
                )
                rows.writerow([rollout, second, *values])


def _draw(
    found: Liveliness,
    detector: FreezeDetector,
    kept: Iterable[Motion],
    like: Clip,
    name: str,
    out: Path,
) -> None:
    """Speed over time, and how the first rollouts look at their ends."""
    from posecast.viewer import draw
    from posecast.viewer.plots import lines

    minutes = [(second + 0.5) / 60 for second in range(found.speed.shape[1])]
    curves = {
        f"rollout {number + 1}": list(zip(minutes, ratios.tolist(), strict=True))
        for number, ratios in enumerate(found.speed_ratio)
    }
    levels = {
        "frozen below": detector.slowest / detector.median,
        "blown above": detector.fastest / detector.median,
    }
    lines(
        curves,
        out / "endurance.png",
        across="minutes",
        upright="speed of joints / the training set's median",
        title=f"{name}: {len(minutes)} seconds",
        levels=levels,
    )
    end = Motion.join_frames([piece.rigid for piece in kept])
    if not all(torch.isfinite(part).all() for part in (end.rotations_local, end.root_positions)):
        say(f"{out / 'endurance.png'} written; the end is no motion any more and is not drawn")
        return
    shown = max(2, min(end.root_positions.shape[1], round(SHOWN_S * like.fps)))
    clips = [one.clip(like, name=name) for one in end.cut(-shown).split(1)[:SHOWN]]
    titles = [f"rollout {number + 1}" for number in range(len(clips))]
    draw(clips, out / "end.png", titles=titles, first_is_truth=False)
    say(f"{out / 'endurance.png'} and {out / 'end.png'} written")

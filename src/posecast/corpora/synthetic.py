"""`synthetic`: walking, jogging, running, turning and stopping, generated from a seed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from posecast.corpora.gait.body import CAST, SKELETON
from posecast.corpora.gait.footfalls import directions
from posecast.corpora.gait.manner import Manner, personal
from posecast.corpora.gait.pace import Journey, planning_times, travel
from posecast.corpora.gait.path import draw_path
from posecast.corpora.gait.performer import Performance, perform, pose
from posecast.corpora.gait.repertoire import REPERTOIRE, Act, reserved_style, speed_unit
from posecast.corpora.gait.signals import Wobble
from posecast.errors import ConfigError
from posecast.motion.clip import Clip
from posecast.motion.corpus import Corpus

SHORTEST, LONGEST = 6.0, 12.0
"""Seconds: the length of a clip where none is asked for."""

MARGIN = 3.0
"""Seconds planned before the first and after the last frame, so that no clip begins abruptly."""

ROUND = 6
"""In so many performances of one act, one is for testing and one for validation."""

_PERSON, _DECK = 1 << 20, 1 << 21
"""Keys of random streams that no clip has for its own."""


def synthetic(
    *,
    root: object = None,
    cache: object = None,
    fps: float | int = 50.0,
    seed: int = 0,
    clips: int = 72,
    seconds: float | int | None = None,
) -> Corpus:
    """Generate a corpus of locomotion: always there, the same on every run.

    Eight bodies, from a child to a tall adult, perform an endless repertoire (walk, turn, jog,
    run, start and stop, change speed) in six styles along straight lines, arcs, s-curves, figures
    of eight, around corners and wandering. Feet are planted: while a foot is in contact, its toe
    joint does not move at all. More clips leave the first ones as they are, and another frame
    rate samples the same movements.

    Of every six performances of an act, four are for training, one for validation, one for
    testing. All bodies and all styles occur in training, but one style of most bodies only in
    test clips: about half of these show a pair of body and style that training never saw.

    Labels: ``action`` (walk, turn, jog, run, start-stop, speed-change), ``gait`` (walk, jog, run,
    mixed), ``path``, ``style``, ``body``, ``subject``. Tracks, one value a frame:

    - ``phase``: radians, growing by pi with each step: 0 modulo 2 pi when the right foot touches
      down, pi when the left one does, linear in between, constant while standing still;
    - ``contacts``: left and right, whether the ball of the foot is planted; in walking the heel
      touches down first, a twelfth of a cycle earlier;
    - ``speed``: m/s along the path, without the surge within each step;
    - ``facing``: unit vector (x, z), without the turning of the pelvis within each step;
    - ``path``: (x, z) of the path at the body, metres: the hips sway about it.

    Args:
        root, cache: not needed, nothing is read or parsed; accepted as of every corpus.
        fps: frames per second.
        seed: another seed, other movements by other people of the same bodies.
        clips: how many.
        seconds: length of every clip; ``None``: each its own, 6 to 12 seconds.

    Raises:
        ConfigError: a frame rate or length that is not positive, a negative seed, or fewer clips
            than give every split one.
    """
    if not fps > 0 or (seconds is not None and not seconds * fps >= 1):
        raise ConfigError(
            f"synthetic: {fps} frames per second, clips of {seconds} seconds; "
            "both must be positive, and a clip at least one frame long"
        )
    if seed < 0:
        raise ConfigError(f"synthetic: seed {seed}; expected 0 or more")
    if clips < ROUND:
        raise ConfigError(f"synthetic: {clips} clips; at least {ROUND} give every split one")
    splits: dict[str, list[int]] = {"train": [], "validation": [], "test": []}
    for index in range(clips):
        splits[split_of(index)].append(index)
    return Corpus(
        name="synthetic",
        clips=[make_clip(index, fps=fps, seed=seed, seconds=seconds) for index in range(clips)],
        splits={name: tuple(members) for name, members in splits.items()},
    )


def split_of(index: int) -> str:
    """Which split a clip is in: by its act, and by how often that was performed before."""
    often, act = divmod(index, len(REPERTOIRE))
    return {2: "validation", 5: "test"}.get((act + often) % ROUND, "train")


def make_clip(
    index: int, *, fps: float | int = 50.0, seed: int = 0, seconds: float | int | None = None
) -> Clip:
    """Generate one clip of the corpus, whatever the others are.

    Args:
        index: which one, from 0; see ``synthetic`` for the rest.
    """
    role = _cast(index, seed)
    way, life = _stream(seed, index, 1), _stream(seed, index, 2)
    length = float(way.uniform(SHORTEST, LONGEST)) if seconds is None else float(seconds)
    journey = _plan_journey(role, length, way)
    performance = perform(CAST[role.subject], role.manner, journey, life)
    times = np.arange(max(1, round(length * fps))) / fps
    frames = pose(performance, times)
    body = CAST[role.subject]
    return Clip(
        skeleton=SKELETON,
        offsets=body.offsets.clone(),
        fps=fps,
        root_positions=frames.root_positions,
        rotations_local=frames.rotations_local,
        name=f"{index:03d}-{role.act.action}-{role.path}-{role.style}-{body.name}",
        labels={
            "action": role.act.action,
            "gait": role.act.gait,
            "path": role.path,
            "style": role.style,
            "body": body.name,
            "subject": f"{role.subject + 1:02d}",
        },
        tracks=_tracks(performance, times),
    )


class _Role(NamedTuple):
    """What a clip shows."""

    act: Act
    path: str
    subject: int
    style: str
    manner: Manner


def _stream(seed: int, *key: int) -> np.random.Generator:
    """Random numbers that depend on nothing but the seed and the key."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _cast(index: int, seed: int) -> _Role:
    """Choose who performs what, how and along which kind of path."""
    act, draw = REPERTOIRE[index % len(REPERTOIRE)], _stream(seed, index, 0)
    deal, place = divmod(index, len(CAST))
    subject = int(_stream(seed, _DECK, deal).permutation(len(CAST))[place])
    style = _style(index, seed, act, reserved_style(subject))
    manner = personal(style, _stream(seed, _PERSON, subject), draw)
    return _Role(act, str(draw.choice(act.paths)), subject, style, manner)


def _style(index: int, seed: int, act: Act, reserved: str | None) -> str:
    """The reserved style if this is for testing; else the next one of a shuffled deck."""
    if split_of(index) == "test" and reserved in act.styles:
        return str(reserved)
    slot, (deal, place) = index % len(REPERTOIRE), divmod(index // len(REPERTOIRE), len(act.styles))
    deck = [str(style) for style in _stream(seed, _DECK, slot, deal).permutation(act.styles)]
    return deck[place] if deck[place] != reserved else deck[place - 1]


def _plan_journey(role: _Role, seconds: float, draw: np.random.Generator) -> Journey:
    """Draw speeds and a path, with curves that suit the fastest of them."""
    body = CAST[role.subject]
    unit = speed_unit(role.act, body, role.manner)
    program = role.act.program(draw, seconds, unit)
    times = planning_times(seconds, MARGIN)
    fastest = float(program.speed(times).max())
    path = draw_path(
        role.path,
        draw,
        before=1.3 * fastest * MARGIN,
        ahead=1.3 * fastest * (seconds + MARGIN),
        scale=max(2.1 * body.size, fastest**2 / 1.3),
    )
    return travel(
        path,
        program,
        times,
        restlessness=Wobble.draw(draw, 0.05, 0.3),
        sideways=0.9 if role.act.gait == "walk" else 2.4,
    )


def _tracks(performance: Performance, times: Float[ndarray, " times"]) -> dict[str, Tensor]:
    """What is known about the gait, frame by frame; see ``synthetic``."""
    left, right = performance.feet(times)
    journey = performance.journey
    values = {
        "phase": _phase(performance, times),
        "contacts": np.stack([left.planted, right.planted], axis=-1),
        "speed": journey.speed(times),
        "facing": directions(performance.carriage.facing(times))[0],
        "path": journey.path.at(journey.distance(times)).position,
    }
    return {name: torch.from_numpy(np.ascontiguousarray(value)) for name, value in values.items()}


def _phase(performance: Performance, times: Float[ndarray, " times"]) -> Float[ndarray, " times"]:
    """Place in the walk cycle, radians: linear between touch-downs, held at rest."""
    touchdowns, numbers = performance.rhythm.touchdowns, performance.rhythm.numbers
    departures = np.array([end for _, end in performance.journey.rests if end < np.inf])
    standing = np.searchsorted(touchdowns, departures, side="right") - 1
    knots = np.concatenate([touchdowns, departures])
    order = np.argsort(knots, kind="stable")
    steps = np.concatenate([numbers, numbers[standing]])
    return np.interp(times, knots[order], np.pi * steps[order])

"""Scores of a walk along a course: does it keep to it, do the feet stand, does it look alive."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.evaluation import following
from posecast.evaluation.following import Followed, frame_times
from posecast.evaluation.footing import NEAR, Stance, depths, floor_contacts, sliding, stance_of
from posecast.evaluation.spectra import Spectrum, power_ratio, spectrum_distance, spectrum_of
from posecast.evaluation.walked import Walked, world_positions
from posecast.motion import Clip, Path
from posecast.skeleton import Skeleton


class WalkScores(NamedTuple):
    """Scores of one walk; NaN where there is nothing to measure. Exact definitions: docs/walks.md.

    Args:
        path_mean: distance of the root to the path, metres, mean over frames.
        path_max: the largest.
        arrival_mean: seconds by which way points are passed early or late, mean.
        arrival_max: the largest.
        facing: degrees between where the body faces and where it is to, mean.
        speed: m/s by which the root is too fast or too slow, mean.
        standing: share of frames and feet on the floor.
        slide_path: cm that a foot moves over the floor in a contact, mean.
        slide_straight: cm from where a contact begins to where it ends, mean.
        slide_fast: share of contact frames in which the foot is faster than 0.205 leg lengths a
            second.
        sink_mean: cm that feet are in the floor, mean over frames and feet.
        sink_max: the largest.
        lean: degrees of the upper body from upright, mean.
        jitter: m/s^3, third derivative of joint positions, mean of its length.
        bone_drift: mm by which a bone is longer or shorter than at rest, the largest.
        spectrum: Hz, distance of normalized power spectra to those of real clips.
        power: power of movements as a multiple of that of real clips.
    """

    path_mean: float
    path_max: float
    arrival_mean: float
    arrival_max: float
    facing: float
    speed: float
    standing: float
    slide_path: float
    slide_straight: float
    slide_fast: float
    sink_mean: float
    sink_max: float
    lean: float
    jitter: float
    bone_drift: float
    spectrum: float
    power: float


class Reference(NamedTuple):
    """What real walks are like.

    Args:
        stance: how low their feet stand above the floor, which is at height 0.
        spectrum: of their joint positions; ``None``: all are shorter than a window of it.
        skeleton: whose joints these are.
        fps: their frames per second.
    """

    stance: Stance
    spectrum: Spectrum | None
    skeleton: Skeleton
    fps: float


def reference_of(clips: Iterable[Clip]) -> Reference:
    """What some clips are like, such as the training clips of one style that walk.

    Raises:
        ConfigError: there are none, or they differ in skeleton or frame rate.
        DataError, SkeletonError: see ``analyse_gait``.
    """
    walked = [Walked.of(clip) for clip in clips]
    if not walked:
        raise ConfigError("no clip to compare walks with; name a split and a style that walk")
    first = walked[0].clip
    if any((w.clip.skeleton, w.clip.fps) != (first.skeleton, first.fps) for w in walked):
        raise ConfigError("clips of several skeletons or frame rates; give those of one corpus")
    return Reference(
        stance_of((each.toes, each.ankles, each.leg) for each in walked),
        spectrum_of([each.features for each in walked], fps=first.fps),
        first.skeleton,
        first.fps,
    )


def score_walk(
    clip: Clip,
    course: Followed | None = None,
    *,
    reference: Reference | None = None,
    start: float = 0.0,
    near: float = NEAR,
) -> WalkScores:
    """Score one walk.

    What is walked beyond the end of an open course counts for arrivals alone.

    Args:
        clip: of somebody with two feet, on a floor at height 0.
        course: what was to be followed; ``None``: nobody asked for anything, as of a recording:
            its path is its own without the sway of single steps, and nothing else is asked.
        reference: real walks; ``None``: nothing is compared with them, and feet stand where their
            joints are at height 0.
        start: seconds after the start of the course of the first frame.
        near: see ``floor_contacts``.

    Raises:
        ConfigError: ``near`` is not positive, the reference is of another skeleton or frame rate,
            or the clip begins after the end of its course.
        DataError, SkeletonError: see ``analyse_gait``.
    """
    if reference and (reference.skeleton, reference.fps) != (clip.skeleton, clip.fps):
        raise ConfigError(
            f"clip {clip.name!r} has another skeleton or frame rate than the walks it is compared "
            "with; compare it with clips of its own corpus at its own frame rate"
        )
    whole = world_positions(clip)[:, clip.skeleton.roots[0]][:, [0, 2]]
    if course is not None and not course.path.closed:
        asked = math.floor((course.duration - start) * clip.fps + 1e-6) + 1
        if asked < 1:
            raise ConfigError(
                f"a walk from {start:g} s on, but its course ends after {course.duration:.4g} s; "
                "score what lies before"
            )
        clip = clip.cut(0, min(clip.frames, asked))
    walked = Walked.of(clip)
    return WalkScores(
        **_following(walked, course, whole, start),
        **_standing(walked, reference, near),
        lean=walked.lean,
        jitter=walked.jitter,
        bone_drift=walked.bone_drift,
        **_compared(walked, reference),
    )


def _following(
    walked: Walked, course: Followed | None, whole: Float[Tensor, "_ 2"], start: float
) -> dict[str, float]:
    """Of ``WalkScores`` what a course asks; ``whole`` is the root, beyond the end as well."""
    fps, reach = walked.clip.fps, following.REACH * walked.leg
    if course is None:
        own = Path.along(walked.gait.path, name=walked.clip.name or "clip")
        away = following.path_distances(walked.root, own, near=own.marks, reach=reach)
        found = {"path_mean": float(away.mean()), "path_max": float(away.max())}
        return found | dict.fromkeys(("arrival_mean", "arrival_max", "facing", "speed"), math.nan)
    times = frame_times(walked.clip.frames, fps=fps, start=start)
    near = course.distance(times)
    away = following.path_distances(walked.root, course.path, near=near, reach=reach)
    late = following.arrival_errors(whole, course, fps=fps, start=start).abs()
    return {
        "path_mean": float(away.mean()),
        "path_max": float(away.max()),
        "arrival_mean": float(late.mean()),
        "arrival_max": float(late.max()) if len(late) else math.nan,
        "facing": float(following.facing_errors(walked.gait, course, times).mean()),
        "speed": float(following.speed_errors(walked.gait, course, times).mean()),
    }


def _standing(walked: Walked, reference: Reference | None, near: float) -> dict[str, float]:
    """Of ``WalkScores`` what feet do."""
    fps, leg = walked.clip.fps, walked.leg
    contacts = floor_contacts(walked.toes, fps=fps, leg=leg, near=near)
    slides = sliding(walked.toes, contacts, fps=fps, leg=leg)
    stance = Stance() if reference is None else reference.stance
    sunk = depths(walked.toes, walked.ankles, leg=leg, stance=stance)
    return {
        "standing": slides.share,
        "slide_path": slides.path_cm,
        "slide_straight": slides.straight_cm,
        "slide_fast": slides.fast,
        "sink_mean": float(sunk.mean()),
        "sink_max": float(sunk.max()),
    }


def _compared(walked: Walked, reference: Reference | None) -> dict[str, float]:
    """Of ``WalkScores`` what is compared with real walks."""
    true = None if reference is None else reference.spectrum
    found = None if true is None else spectrum_of([walked.features], fps=walked.clip.fps)
    if true is None or found is None:
        return {"spectrum": math.nan, "power": math.nan}
    return {"spectrum": spectrum_distance(found, true), "power": power_ratio(found, true)}

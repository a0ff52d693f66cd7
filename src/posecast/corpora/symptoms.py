"""What looks wrong in the motion itself: size, axes, frame rate, bones, jumps."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from statistics import median

from posecast.corpora.cmu import SALSA_FPS
from posecast.corpora.findings import Evidence, Finding, some
from posecast.io.bvh_layout import UNITS

_SHORTEST_BODY, _TALLEST_BODY = 0.8, 2.3
_SHORTEST_SWING, _LONGEST_SWING = 0.25, 1.1
"""Seconds off the floor between which the steps of people of usual height last."""
_USUAL_SWING = 0.45
_USUAL_HEIGHT = 1.55
_FEWEST_SWINGS = 8


def units(evidence: Evidence) -> Iterator[Finding]:
    """Bodies that are no size of a person's, and units that differ from file to file."""
    heights = {fact.name: fact.height for fact in evidence.readable if fact.height > 0}
    if not heights:
        return
    odd = [name for name, height in heights.items() if not _is_human(height)]
    # Somebody who kneels throughout a clip is small too: ask the body as it usually stands.
    if odd and not _is_human(median(heights.values())):
        height = median(heights.values())
        units = {fact.unit for fact in evidence.readable if fact.unit}
        fitting = [
            name
            for name, meters in UNITS.items()
            if any(_is_human(height / unit * meters) for unit in units or {1.0})
        ]
        yield Finding(
            "unit",
            "warning",
            f"the body reaches {height:.3g} m high, which is no person's height",
            f"give the unit; {' or '.join(fitting) or 'no usual one'} would fit",
            tuple(odd),
        )
    found = Counter(fact.unit for fact in evidence.readable if fact.unit)
    if len(found) > 1:
        usual = found.most_common(1)[0][0]
        yield Finding(
            "unit",
            "warning",
            "the unit guessed from the body differs: "
            + ", ".join(f"{unit:g} m in {count} files" for unit, count in found.most_common()),
            "give the unit if all files have the same",
            tuple(fact.name for fact in evidence.readable if fact.unit != usual),
        )


def _is_human(height: float) -> bool:
    return _SHORTEST_BODY < height < _TALLEST_BODY


def axes(evidence: Evidence) -> Iterator[Finding]:
    """A vertical axis, by the motion, that is not y or not the same in all files."""
    found = Counter(fact.up for fact in evidence.readable if fact.up)
    if not found or (len(found) == 1 and "y" in found):
        return
    usual, count = found.most_common(1)[0]
    if count < found.total():
        others = tuple(fact.name for fact in evidence.readable if fact.up not in ("", usual))
        yield Finding(
            "up axis",
            "warning",
            f"{usual} is up in {count} files, another axis in {len(others)}, by their motion",
            f"give up={usual!r} if it is the same in all",
            others,
        )
    elif any(fact.unit for fact in evidence.readable):
        yield Finding(
            "up axis", "note", f"{usual} is up in the files", "nothing: turned to y when read"
        )
    else:
        yield Finding(
            "up axis",
            "warning",
            f"by the motion {usual} is up; y was expected",
            "turn the motion before it is written in this format",
        )


def frame_rate(evidence: Evidence) -> Iterator[Finding]:
    """Rates that differ, or at which people would step too quickly or slowly."""
    rates = Counter(fact.fps for fact in evidence.readable)
    if len(rates) > 1 and max(rates) / min(rates) > 1.001:
        yield Finding(
            "frame rate",
            "note" if evidence.kind == "amass" else "warning",
            "frame rates differ: "
            + ", ".join(f"{fps:g} in {count} files" for fps, count in rates.most_common()),
            "nothing: brought to one when read"
            if evidence.kind == "amass"
            else "give fps to bring all to one",
        )
    swings = [(time, fact) for fact in evidence.readable for time in fact.swings]
    if len(swings) < _FEWEST_SWINGS:
        return
    time = median(time for time, _ in swings)
    # A leg swings like a pendulum: a short one is quicker, by the root of its length.
    size = math.sqrt(median(fact.height for _, fact in swings) / _USUAL_HEIGHT)
    if _SHORTEST_SWING * size < time < _LONGEST_SWING * size:
        return
    fps = rates.most_common(1)[0][0]
    pace = "quicker" if time < _USUAL_SWING else "slower"
    remedy = (
        f"the recordings have perhaps {_likely_rate(fps, time / size):g} fps: set the right one"
    )
    if evidence.kind == "cmu-salsa":
        remedy = f"use the corpus cmu-salsa, which reads {SALSA_FPS:g} fps"
    yield Finding(
        "frame rate",
        "warning",
        f"at the {fps:g} fps of the files a foot swings for {time:.2f} s on a step, {pace} than "
        "people step",
        remedy,
    )


def _likely_rate(fps: float, swing: float) -> float:
    """The usual rate at which swings would last as long as they do when people walk."""
    usual = (24, 25, 30, 50, 60, 100, 120, 240)
    return min(usual, key=lambda rate: abs(math.log(fps * swing / _USUAL_SWING / rate)))


def bones(evidence: Evidence) -> Iterator[Finding]:
    """Bones of length zero, and bones whose length changes."""
    without = Counter(name for fact in evidence.readable for name in fact.without_length)
    if without:
        yield Finding(
            "zero length",
            "note",
            f"{len(without)} joints lie on their parent: {some(list(without))}",
            "nothing for rotations; such bones have no direction to learn or to fit",
        )
    moving = Counter(name for fact in evidence.readable for name in fact.moving)
    if not moving:
        return
    if evidence.kind == "bandai-locomotion" and set(moving) == {"Hips"}:
        yield Finding(
            "upper root",
            "note",
            "joint_Root stands still and Hips moves below it",
            "use the corpus bandai-locomotion, which folds joint_Root into Hips",
        )
    else:
        yield Finding(
            "moving bones",
            "note",
            f"{len(moving)} joints change their distance from the parent: {some(list(moving))}",
            "networks take the mean; leave the files out if that is too coarse",
            tuple(fact.name for fact in evidence.readable if fact.moving),
        )


def first_frames(evidence: Evidence) -> Iterator[Finding]:
    """T poses that a conversion put before the first frame."""
    posed = tuple(fact.name for fact in evidence.readable if fact.t_pose)
    if posed:
        yield Finding(
            "T pose",
            "note" if evidence.kind == "cmu-salsa" else "warning",
            f"the first frame of {len(posed)} files is an inserted T pose",
            "use the corpus cmu-salsa, which drops it"
            if evidence.kind == "cmu-salsa"
            else "cut it off, or networks learn the jump after it",
            posed,
        )


def jumps(evidence: Evidence) -> Iterator[Finding]:
    """Roots that leap and joints that flip from one frame to the next."""
    leaps = [(jump, fact) for fact in evidence.readable for jump in fact.leaps]
    if leaps:
        jump, fact = max(leaps, key=lambda found: found[0].amount)
        yield Finding(
            "jump",
            "warning",
            f"the root leaps {len(leaps)} times, the farthest {jump.amount:.2f} m from one frame "
            f"to the next ({fact.name}, frame {jump.frame})",
            "cut these frames away, or leave the files out",
            tuple(dict.fromkeys(fact.name for _, fact in leaps)),
        )
    flips = [(jump, fact) for fact in evidence.readable for jump in fact.flips]
    if flips:
        jump, fact = max(flips, key=lambda found: found[0].amount)
        joints = Counter(flip.joint for flip, _ in flips)
        yield Finding(
            "jump",
            "note",
            f"joints flip between two frames ({some([name for name, _ in joints.most_common()])}); "
            f"the most by {math.degrees(jump.amount):.0f} degrees: {jump.joint} in {fact.name}, "
            f"frame {jump.frame}",
            "single frames do little harm; leave out files where it matters",
            tuple(dict.fromkeys(fact.name for _, fact in flips)),
        )

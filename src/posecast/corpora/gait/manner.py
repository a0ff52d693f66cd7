"""Manners: how somebody walks, as a dozen numbers; named styles and personal variations of them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np


@dataclass(frozen=True)
class Manner:
    """A way of walking and running. Factors are 1.0, angles as given, for a neutral adult.

    Args:
        pace: factor on the speed.
        tempo: factor on the step rate at a given speed; above 1, shorter and quicker steps.
        width: factor on the distance between the two lines of footprints.
        toe_out: how far the feet point outwards, radians.
        strike: foot above flat as the heel touches down, in an average step, radians.
        push: factor on the heel's rise before the toes leave the floor.
        lift: factor on the clearance of the swinging foot.
        knee: share of the leg's length that the hips sink below a straight leg in mid-stance.
        bounce: factor on the rise and fall that walking and running add to that.
        sway: factor on the sideways shift over the standing foot.
        twist: factor on the turn of pelvis and chest against each other.
        drop: factor on the drop of the pelvis on the side of the swinging leg.
        lean: trunk leaning forward at rest, radians.
        slouch: bend of the upper back, taken up again by the neck, radians.
        swing: factor on the swing of the arms.
        arms_out: upper arms held away from the trunk, radians.
        elbow: bend of the elbows in walking, radians.
        gaze: head tilted down, radians.
        restlessness: factor on all slow variation.
        unevenness: right side against left in arm swing, -1 to 1; mostly near zero.
    """

    pace: float = 1.0
    tempo: float = 1.0
    width: float = 1.0
    toe_out: float = 0.12
    strike: float = 0.36
    push: float = 1.0
    lift: float = 1.0
    knee: float = 0.008
    bounce: float = 1.0
    sway: float = 1.0
    twist: float = 1.0
    drop: float = 1.0
    lean: float = 0.03
    slouch: float = 0.10
    swing: float = 1.0
    arms_out: float = 0.13
    elbow: float = 0.30
    gaze: float = 0.04
    restlessness: float = 1.0
    unevenness: float = 0.0


STYLES: dict[str, Manner] = {
    "neutral": Manner(),
    "relaxed": Manner(
        pace=0.92,
        tempo=0.94,
        toe_out=0.18,
        sway=1.3,
        twist=1.35,
        drop=1.2,
        lean=0.0,
        slouch=0.16,
        swing=1.25,
        elbow=0.24,
        restlessness=1.4,
    ),
    "brisk": Manner(
        pace=1.08,
        tempo=1.04,
        width=0.85,
        strike=0.42,
        push=1.08,
        sway=0.8,
        lean=0.08,
        slouch=0.06,
        swing=1.3,
        elbow=0.55,
        restlessness=0.8,
    ),
    "proud": Manner(
        toe_out=0.16,
        push=1.12,
        lift=1.2,
        bounce=1.25,
        twist=0.8,
        lean=-0.05,
        slouch=-0.06,
        swing=1.1,
        arms_out=0.20,
        gaze=-0.06,
    ),
    "tired": Manner(
        pace=0.80,
        tempo=0.97,
        width=1.25,
        strike=0.22,
        push=0.78,
        lift=0.6,
        knee=0.026,
        lean=0.10,
        slouch=0.38,
        swing=0.55,
        elbow=0.20,
        gaze=0.22,
    ),
    "sneaking": Manner(
        pace=0.74,
        tempo=0.90,
        width=1.2,
        strike=0.12,
        push=0.9,
        lift=2.6,
        knee=0.105,
        bounce=0.6,
        twist=0.7,
        lean=0.30,
        slouch=0.24,
        swing=0.5,
        arms_out=0.26,
        elbow=0.95,
        gaze=-0.10,
    ),
}
"""Named styles; what a style does not mention is as in the neutral one."""

SPREAD = Manner(
    pace=0.04,
    tempo=0.04,
    width=0.16,
    toe_out=0.05,
    strike=0.04,
    push=0.06,
    lift=0.15,
    knee=0.003,
    bounce=0.12,
    sway=0.15,
    twist=0.18,
    drop=0.18,
    lean=0.025,
    slouch=0.04,
    swing=0.18,
    arms_out=0.03,
    elbow=0.08,
    gaze=0.04,
    restlessness=0.15,
    unevenness=0.25,
)
"""Standard deviation of each number between people; one person varies by half of it."""

WIDEST = 1.8
"""Standard deviations at which a variation is cut off, so that nobody becomes a caricature."""


def personal(style: str, person: np.random.Generator, mood: np.random.Generator) -> Manner:
    """A named style as one person performs it on one day.

    Args:
        person: draws what all recordings of this person share; give it fresh each time.
        mood: draws what is particular to this recording.
    """
    base = STYLES[style]
    varied: dict[str, float] = {}
    for entry in fields(Manner):
        own = np.clip(person.standard_normal(), -WIDEST, WIDEST)
        today = np.clip(mood.standard_normal(), -WIDEST, WIDEST)
        change = float(getattr(SPREAD, entry.name) * (own + today / 2))
        varied[entry.name] = getattr(base, entry.name) + change
    varied["knee"] = max(varied["knee"], 0.004)
    return replace(base, **varied)

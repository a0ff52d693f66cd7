"""Where feet stand, also while they slide."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from posecast.corpora.synthetic import synthetic
from posecast.motion import Clip, find_feet, leg_length
from posecast.motion.standing import Stand, find_stands, median_place
from posecast.skeleton.kinematics import joint_positions

LEG = 0.9


def toes_and_leg(clip: Clip) -> tuple[Tensor, float]:
    feet = find_feet(clip.skeleton, clip.offsets)
    positions = joint_positions(
        clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions
    )
    return positions[:, list(feet.toes)], leg_length(clip.skeleton, clip.offsets, feet)


def as_frames(stands: list[Stand], frames: int) -> Tensor:
    found = torch.zeros(frames, 2, dtype=torch.bool)
    for stand in stands:
        found[stand.frames, stand.foot] = True
    return found


@pytest.mark.parametrize("fps", [30.0, 60.0])
@pytest.mark.parametrize("slide", [0.0, 0.1])
def test_stands_are_the_contacts_of_the_generator_however_feet_slide(
    fps: float, slide: float
) -> None:
    """With the root farther by a tenth feet slide at up to 0.5 m/s: in running too fast."""
    both = found = true = 0
    for clip in synthetic(fps=fps, clips=18).clips:
        toes, leg = toes_and_leg(clip)
        farther = toes + slide * clip.root_positions[:, None] * toes.new_tensor((1.0, 0.0, 1.0))
        stands = as_frames(find_stands(farther, fps=fps, leg=leg), clip.frames)
        contacts = clip.tracks["contacts"]
        both += int((stands & contacts).sum())
        found += int(stands.sum())
        true += int(contacts.sum())
    assert both / found > 0.98
    assert both / true > (0.95 if slide == 0 else 0.85)


def feet(frames: int = 60) -> Tensor:
    """Both stand still."""
    places = torch.zeros(frames, 2, 3, dtype=torch.float64)
    places[..., 1] = 0.05
    return places


def stands_of(places: Tensor) -> list[Stand]:
    return find_stands(places, fps=30, leg=LEG)


def test_a_foot_that_slides_steadily_stands_and_one_that_is_carried_does_not() -> None:
    for speed, expected in ((0.5, True), (0.65, False)):
        places = feet()
        places[:, 0, 0] = torch.arange(60) / 30 * speed * LEG
        assert (Stand(0, 0, 59) in stands_of(places)) == expected
        assert Stand(1, 0, 59) in stands_of(places)


def test_a_foot_that_rises_quickly_or_is_high_does_not_stand() -> None:
    places = feet()
    places[20:, 0, 1] += torch.arange(40) / 30 * 0.25 * LEG
    places[30:, 1, 1] += 0.1 * LEG
    assert {(stand.foot, stand.first) for stand in stands_of(places)} == {(0, 0), (1, 0)}
    assert all(18 <= stand.last <= 30 for stand in stands_of(places))


def test_a_foot_that_rests_stands_only_as_long_as_it_does() -> None:
    places = feet()
    places[:20, 0, 2] = (torch.arange(20) - 20) * 0.002
    assert stands_of(places)[0] == Stand(0, 20, 59)
    places[20:, 0, 2] = torch.arange(40) * 0.002
    assert stands_of(places)[0] == Stand(0, 0, 59)


def test_a_foot_that_touches_down_for_a_moment_does_not_stand() -> None:
    places = feet()
    places[20:, 0, 1] += 0.2
    places[40:42, 0, 1] -= 0.2
    assert [(stand.foot, stand.first) for stand in stands_of(places)] == [(0, 0), (1, 0)]
    assert not stands_of(feet(2))


def test_the_median_place_has_the_least_way_to_all_others(generator: torch.Generator) -> None:
    places = torch.randn(301, 2, generator=generator, dtype=torch.float64)
    ways = (places[:, None] - places).norm(dim=-1).sum(-1)
    assert median_place(places) == int(ways.argmin())
    many = places.repeat(40, 1)
    assert ways[median_place(many) % 301] < 1.02 * ways.min()
    assert median_place(torch.zeros(9, 2)) == 0

"""Gait analysis against what generated clips know of themselves, and against what is published."""

from __future__ import annotations

import math
from functools import cache
from itertools import chain

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d
from torch import Tensor
from torch.testing import assert_close

from posecast.corpora.synthetic import make_clip as make_walk
from posecast.corpora.synthetic import synthetic
from posecast.motion import Clip, Corpus, analyse_gait, find_feet, integrated_offset, leg_length
from posecast.motion.facing import root_heading
from posecast.motion.walk_cycle import find_walk_cycle
from posecast.skeleton.kinematics import joint_positions


@cache
def corpus(fps: float) -> Corpus:
    return synthetic(fps=fps, clips=36)


def of_gait(fps: float, *gaits: str) -> list[Clip]:
    chosen = [clip for clip in corpus(fps).clips if clip.labels["gait"] in gaits]
    assert len(chosen) >= 3
    return chosen


def apart(found: Tensor, true: Tensor) -> Tensor:
    """Distance on the circle, radians, signed."""
    return torch.remainder(found - true + math.pi, 2 * math.pi) - math.pi


def steps_of(clip: Clip) -> Tensor:
    """Radians a second of the generated phase."""
    return torch.gradient(clip.tracks["phase"])[0] * clip.fps


def mean(values: list[Tensor]) -> float:
    return float(torch.stack(values).mean())


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_contacts_are_those_of_the_generator(fps: float) -> None:
    """Heels touch down a little before balls do: that is most of the difference in walking."""
    for gaits in (("walk",), ("jog", "run"), ("mixed",)):
        share = [
            (analyse_gait(clip).contacts == clip.tracks["contacts"]).double().mean()
            for clip in of_gait(fps, *gaits)
        ]
        assert mean(share) > 0.95


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_the_phase_is_that_of_the_generator(fps: float) -> None:
    """In running feet are equally fast in the flight before a touch-down, half a radian early."""
    differences: dict[str, list[Tensor]] = {"walk": [], "jog": [], "run": []}
    for gait, found in differences.items():
        for clip in of_gait(fps, gait):
            gait_found, moving = analyse_gait(clip), steps_of(clip) > 0.5
            counted = gait_found.walking & moving
            assert counted.double().mean() > 0.97 * moving.double().mean()
            found.append(apart(gait_found.phase, clip.tracks["phase"])[counted])
    median = {gait: float(torch.cat(found).median()) for gait, found in differences.items()}
    assert abs(median["walk"]) < 0.06
    assert 0.2 < median["jog"] < 0.4
    assert 0.4 < median["run"] < 0.6
    assert torch.cat(differences["walk"]).abs().quantile(0.95) < 0.15
    assert torch.cat(list(chain(*differences.values()))).abs().median() < 0.3


def test_people_walk_where_the_generator_lets_them_step() -> None:
    agree, rates = [], []
    for clip in of_gait(30.0, "walk", "mixed"):
        found, steps = analyse_gait(clip), steps_of(clip)
        agree.append((found.walking == (steps > 0.5)).double().mean())
        both = found.walking & (steps > 0.5)
        rates.append((found.step_rate[both] / steps[both] - 1).abs().median())
        assert (found.step_rate[~found.walking] == 0).all()
    assert mean(agree) > 0.99
    assert mean(rates) < 0.015


@pytest.mark.parametrize(("pause", "walks"), [(0.15, True), (0.9, False)])
def test_both_feet_may_be_still_for_a_moment_of_a_walk(pause: float, walks: bool) -> None:
    """Steps of half a second, left and right in turn, with pauses; the clip begins in one."""
    fps, step = 60.0, 0.5
    times = torch.arange(420, dtype=torch.float64) / fps + 5 * (step + pause) - 0.1
    ankles = torch.zeros(420, 2, 3, dtype=torch.float64)
    for number in range(40):
        share = ((times - number * (step + pause)) / step).clamp(0, 1)
        ankles[:, number % 2, 2] += 0.6 * share
    found = find_walk_cycle(ankles, fps=fps, leg=0.9)
    assert bool(found.walking.all()) == walks
    assert not found.walking.all() or (found.phase.diff() > 0).all()
    steps = found.phase[-1] / math.pi
    assert steps == pytest.approx(7 / (step + pause), abs=1.5)


def test_path_speed_and_facing_are_those_of_the_generator() -> None:
    path, speed, length, facing = [], [], [], []
    for clip in corpus(30.0).clips:
        found = analyse_gait(clip)
        path.append((found.path - clip.tracks["path"]).norm(dim=-1).mean())
        moving = clip.tracks["speed"] > 0.3
        speed.append((found.speed / clip.tracks["speed"] - 1)[moving].abs().median())
        true = clip.tracks["path"].diff(dim=0).norm(dim=-1).sum()
        length.append((found.distance[-1] / true - 1).abs())
        cosine = (found.facing * clip.tracks["facing"]).sum(-1).clamp(-1, 1)
        facing.append(torch.rad2deg(torch.acos(cosine)).mean())
    assert mean(path) < 0.01
    assert mean(speed) < 0.03
    assert mean(length) < 0.01
    assert mean(facing) < 1.5


def published_phase(feet: np.ndarray, gap: float) -> np.ndarray:
    """Walk-cycle phase at 30 frames a second as published, one frame after the other."""
    speed = np.linalg.norm(np.diff(feet, axis=0), axis=-1)
    left, resting, last = bool(speed[0, 0] < speed[0, 1]), 3, 0
    phase = [math.pi if left else 0.0]
    switches = [(0, phase[0])]
    for frame in range(3, len(speed)):
        if resting > 0:
            resting -= 1
            continue
        fast, slow = speed[frame] if left else speed[frame, ::-1]
        if fast > slow + gap:
            left, resting, last = not left, 3, frame
            switches.append((frame, switches[-1][1] + math.pi))
    assert last > 0
    times, values = zip(*switches, strict=True)
    return np.interp(np.arange(len(feet)), times, values)


def test_between_its_switches_the_published_phase_is_nearly_ours() -> None:
    """It switches where the threshold is passed, a frame after both feet are equally fast."""
    differences = []
    for clip in of_gait(30.0, "walk", "jog"):
        found, feet = analyse_gait(clip), find_feet(clip.skeleton, clip.offsets)
        leg = leg_length(clip.skeleton, clip.offsets, feet)
        places = joint_positions(
            clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions
        )
        ankles = places[:, list(feet.ankles)].numpy()
        published = torch.from_numpy(published_phase(ankles, 0.1 / 14.65 * leg))
        inner = found.walking.clone()
        inner[:20], inner[-20:] = False, False
        differences.append(apart(found.phase, published)[inner])
    assert torch.cat(differences).abs().median() < 0.12


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_the_published_offset_is_the_sum_of_speed_less_its_gaussian(fps: float) -> None:
    clip = make_walk(1, fps=fps, seconds=8)
    floor = clip.root_positions.numpy()[:, [0, 2]]
    speed = np.linalg.norm(np.diff(floor, axis=0), axis=-1)
    speed = np.append(speed, speed[-1])
    expected = np.cumsum(speed - gaussian_filter1d(speed, 5 * fps / 30))
    assert_close(integrated_offset(clip), torch.from_numpy(expected))


def test_the_published_heading_is_the_y_angle_of_the_root() -> None:
    for clip in corpus(30.0).clips[:12]:
        w, x, y, z = clip.rotations_local[:, 0].unbind(-1)
        heading = torch.atan2(2 * (w * y - x * z), 1 - 2 * (y * y + z * z))
        assert_close(apart(root_heading(clip.rotations_local[:, 0]), heading), 0 * heading)
        facing = analyse_gait(clip, facing="root").facing
        assert_close(facing, torch.stack([heading.sin(), heading.cos()], dim=-1))


def test_the_longitudinal_offset_is_bounded_where_the_published_one_need_not_be() -> None:
    """Three minutes; the published sum is as far off as mean and speed differ at starts."""
    clip = make_walk(0, fps=30.0, seconds=180)
    found = analyse_gait(clip)
    assert found.distance[-1] > 100
    assert found.longitudinal.abs().max() < 0.06
    assert found.lateral.abs().max() < 0.08
    last = found.longitudinal[-900:]
    assert (last.mean() - found.longitudinal[900:1800].mean()).abs() < 1e-3

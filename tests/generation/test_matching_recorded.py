"""Motion matching on recorded clips, which begin and end in full stride."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from posecast.corpora import build_corpus
from posecast.generation import MatchedWalk, MotionMatcher, timed, walked_clip
from posecast.io.path_files import read_waypoints
from posecast.motion import analyse_gait, with_gait
from posecast.motion.tracks import FACING, PATH, SPEED, STEP_RATE
from posecast.skeleton.kinematics import joint_positions

pytestmark = pytest.mark.data

EIGHT = Path(__file__).parents[2] / "examples" / "figure_eight.csv"


def test_recorded_walks_are_laid_along_a_figure_eight(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus(
        "bandai-locomotion", root=data_root / "bandai-locomotion", fps=30, cache=tmp_path
    )
    chosen = [clip for clip in corpus.split("train") if clip.labels["style"] == "normal"]
    matcher = MotionMatcher([with_gait(clip) for clip in chosen], style="normal")
    path = read_waypoints(EIGHT).path(name=EIGHT)
    path = path.with_scalar(SPEED, 1.1).with_scalar(STEP_RATE, 6.0)
    course = timed(path.with_direction(FACING, path.tangents))
    clip = walked_clip(MatchedWalk(matcher, course))

    floor = clip.root_positions[:, [0, 2]]
    assert path.distance_to(floor).mean() < 0.06
    assert path.distance_to(floor).max() < 0.15
    assert (floor - clip.tracks[PATH]).norm(dim=-1).max() < 0.25
    assert clip.root_positions[:, 1].min() > 0.8

    places = joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)
    toes = places[:, list(matcher.feet.toes)]
    lower = toes[1:, :, 1].argmin(dim=-1, keepdim=True)
    speed = toes[..., [0, 2]].diff(dim=0).norm(dim=-1) * clip.fps
    assert speed.gather(1, lower).mean() < 0.2
    contacts = analyse_gait(clip).contacts
    starts = (contacts[1:] & ~contacts[:-1]).nonzero()[:, 1]
    assert len(starts) > 20
    assert (starts.diff() != 0).double().mean() > 0.9


def test_mirrored_clips_are_on_the_bones_of_the_others(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus(
        "bandai-locomotion", root=data_root / "bandai-locomotion", fps=30, cache=tmp_path
    )
    clip = with_gait(next(clip for clip in corpus.clips if clip.labels["content"] == "walk"))
    matcher = MotionMatcher([clip])
    frames, before = matcher.frames, clip.frames
    places = joint_positions(
        matcher.skeleton, frames.rotations_local, matcher.offsets, frames.root_positions
    )
    twins = list(clip.skeleton.mirror_permutation)
    reflect = torch.tensor([-1.0, 1.0, 1.0]).double()
    torch.testing.assert_close(places[before:], places[:before, twins] * reflect, rtol=0, atol=2e-3)

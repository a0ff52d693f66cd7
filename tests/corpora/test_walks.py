"""Corpora of walks: tracks, styles, and one body for all."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from posecast.corpora.synthetic import synthetic
from posecast.corpora.walks import with_walks
from posecast.errors import ConfigError
from posecast.motion.feet import find_feet, leg_length
from posecast.motion.proportions import leg_ratio
from posecast.motion.tracks import LONGITUDINAL, PHASE, STYLE


@pytest.fixture(scope="module")
def corpus():
    return synthetic(fps=30.0, clips=6, seconds=3.0)


def _leg(clip):
    return leg_length(clip.skeleton, clip.offsets, find_feet(clip.skeleton, clip.offsets))


def test_all_walk_on_the_body_of_the_first_training_clip(corpus):
    walks = with_walks(corpus)
    body = corpus.clips[corpus.splits["train"][0]].offsets
    legs = [_leg(clip) for clip in corpus.clips]
    assert max(legs) / min(legs) > 1.1
    for before, after in zip(corpus.clips, walks.clips, strict=True):
        assert torch.equal(after.offsets, body)
        scale = leg_ratio(before.skeleton, before.offsets, body)
        torch.testing.assert_close(after.root_positions, before.root_positions * scale)
        assert torch.equal(after.rotations_local, before.rotations_local)
        assert {PHASE, LONGITUDINAL} <= set(after.tracks)


def test_clips_of_one_body_stay_as_they_are(corpus):
    clip = corpus.clips[0]
    same = replace(corpus, clips=[clip, clip], splits={"train": (1,)})
    for walk in with_walks(same).clips:
        assert torch.equal(walk.root_positions, clip.root_positions)
        assert "body" not in walk.labels or walk.labels == clip.labels


def test_a_style_is_one_among_zeros(corpus):
    styled = replace(
        corpus, clips=[replace(clip, labels={"style": "calm"}) for clip in corpus.clips]
    )
    for clip in with_walks(styled, ("wild", "calm")).clips:
        expected = torch.tensor([0.0, 1.0]).to(clip.root_positions).expand(clip.frames, -1)
        torch.testing.assert_close(clip.tracks[STYLE], expected)
    with pytest.raises(ConfigError, match="is of style 'calm'"):
        with_walks(styled, ("wild",))

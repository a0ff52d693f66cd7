"""A clip is checked once, when it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from posecast.errors import DataError
from posecast.motion import Clip, Motion
from posecast.training import augmentation


@pytest.mark.parametrize("fps", [0.0, -30.0, float("nan"), float("inf")])
def test_a_frame_rate_is_a_positive_number(make_clip: Callable[..., Clip], fps: float) -> None:
    with pytest.raises(DataError, match="expected a positive number"):
        make_clip(fps=fps)


def test_a_clip_has_a_frame(make_clip: Callable[..., Clip]) -> None:
    clip = make_clip(frames=3)
    with pytest.raises(DataError, match="no frames; expected at least one"):
        replace(
            clip,
            root_positions=clip.root_positions[:0],
            rotations_local=clip.rotations_local[:0],
            tracks={},
        )


def test_a_track_has_a_value_for_every_frame(make_clip: Callable[..., Clip]) -> None:
    with pytest.raises(DataError, match="'phase' has 39 values for 40 frames"):
        make_clip(frames=40, tracks={"phase": torch.zeros(39)})


@pytest.mark.parametrize(("start", "stop"), [(-1, 5), (5, 5), (7, 5), (0, 41)])
def test_a_cut_lies_within_the_clip(make_clip: Callable[..., Clip], start: int, stop: int) -> None:
    with pytest.raises(DataError, match=f"frames {start} to {stop} asked for, the clip has 40"):
        make_clip(frames=40).cut(start, stop)


def test_a_cut_takes_the_tracks_along(make_clip: Callable[..., Clip]) -> None:
    clip = make_clip(frames=40, tracks={"phase": torch.arange(40)})
    piece = clip.cut(7, 12)
    assert piece.frames == 5
    assert piece.tracks["phase"].tolist() == [7, 8, 9, 10, 11]
    torch.testing.assert_close(piece.rotations_local, clip.rotations_local[7:12])


def test_a_batch_keeps_what_is_done_in_each_motion(make_clip: Callable[..., Clip]) -> None:
    clips = [
        replace(make_clip(frames=9), labels={"action": action}) for action in ("walk", "sit", "run")
    ]
    batch = Motion.join([clip.motion() for clip in clips])
    assert batch.actions == ("walk", "sit", "run")
    assert batch.cut(3).actions == batch.map(torch.Tensor.double).actions == batch.actions
    assert [piece.actions for piece in batch.split(2)] == [("walk", "sit"), ("run",)]
    assert Motion.join_frames([batch, batch]).actions == batch.actions
    assert batch.rigid.actions == batch.actions
    turned = augmentation.turn(batch, torch.rand(3), clips[0].skeleton)
    mirrored = augmentation.mirror(batch, torch.tensor([True, False, True]), clips[0].skeleton)
    assert turned.actions == mirrored.actions == batch.actions
    assert replace(clips[0], labels={}).motion().actions == ("",)
    # What is not known of one is not known of the batch.
    assert Motion.join([batch, batch._replace(actions=None)]).actions is None

"""Forecasting a clip: at its own rate, on its own joints, beginning one frame after its end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.forecast import forecast_clip, match_joints, rename_joints
from posecast.geometry import quaternion
from posecast.model import ZeroVelocity
from posecast.motion import Clip, Motion
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import forward_kinematics

SKELETON = Skeleton(("Reference", "Hips", "Spine", "Helper", "Head"), (-1, 0, 1, 2, 3))


def _turning(seconds: Tensor) -> Tensor:
    """Rotations (frames, 5, 4) that are a known function of time."""
    joint = torch.arange(5, dtype=torch.float64)
    angle = 0.2 * joint + (0.5 + 0.1 * joint) * seconds[:, None]
    axis = torch.nn.functional.normalize(
        torch.stack([torch.cos(joint), torch.sin(joint), torch.ones(5)], dim=-1).double(), dim=-1
    )
    return quaternion.exp(angle[..., None] * axis)


def _clip(fps: float, frames: int) -> Clip:
    seconds = torch.arange(frames, dtype=torch.float64) / fps
    rotations = _turning(seconds)
    rotations[:, (0, 3)] = rotations[
        :1, (0, 3)
    ]  # the joints the predictor does not know stand still
    offsets = torch.tensor([[0, 0, 0], [0.1, 0.9, 0], [0, 0.3, 0], [0, 0.1, 0.1], [0, 0.2, 0]])
    travel = seconds[:, None] * torch.tensor([[0.3, 0.0, 1.2]]).double()
    return Clip(
        SKELETON,
        offsets.double(),
        fps,
        travel,
        rotations,
        name="turning",
        tracks={"phase": seconds},
        source="as it was written",
    )


@dataclass
class Oracle:
    """Knows a clip by heart and returns the frames after those it is shown."""

    clip: Clip

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        last = prefix.rotations_local[0, -1]
        distance = (self.clip.rotations_local - last).abs().amax(dim=(1, 2))
        begin = int(distance.argmin()) + 1
        assert float(distance.min()) < 1e-9
        piece = self.clip.cut(begin, begin + horizon).motion()
        return Motion(piece.rotations_local, piece.root_positions, prefix.offsets)


def _assert_same_motion(found: Clip, expected: Clip, tolerance: float = 1e-9) -> None:
    angle = quaternion.angle(found.rotations_local, expected.rotations_local)
    assert float(angle.max()) < max(tolerance, 1e-7)  # acos near 1 costs half the digits
    torch.testing.assert_close(
        found.root_positions, expected.root_positions, atol=tolerance, rtol=0
    )


def test_the_forecast_of_an_oracle_is_the_rest_of_the_clip() -> None:
    whole = _clip(25.0, 60)
    forecast = forecast_clip(
        Oracle(whole), whole.cut(0, 40), skeleton=SKELETON, fps=25.0, horizon_ms=400
    )
    assert forecast.frames == 50
    _assert_same_motion(forecast, whole.cut(0, 50))
    assert forecast.source == whole.source
    assert not forecast.tracks


@pytest.mark.parametrize("length", [81, 82, 83, 84])
def test_a_faster_clip_is_continued_from_its_very_last_frame(length: int) -> None:
    fast = _clip(100.0, 160)
    known = fast.cut(0, length)
    # The oracle lives at 25 frames per second, on the frames counted back from the last one.
    phase = (length - 1) % 4
    at_rate = replace(
        fast,
        fps=25.0,
        rotations_local=fast.rotations_local[phase::4],
        root_positions=fast.root_positions[phase::4],
        tracks={},
    )
    forecast = forecast_clip(Oracle(at_rate), known, skeleton=SKELETON, fps=25.0, horizon_ms=200)
    assert forecast.frames == length + 20
    # Each joint turns about one axis at one speed, so interpolation between frames is exact.
    _assert_same_motion(forecast, fast.cut(0, length + 20))


def test_zero_velocity_repeats_the_last_frame_at_any_rate() -> None:
    clip = _clip(60.0, 50)
    forecast = forecast_clip(ZeroVelocity(), clip, skeleton=SKELETON, fps=25.0, horizon_ms=500)
    assert forecast.frames == 50 + 30
    torch.testing.assert_close(forecast.root_positions[:50], clip.root_positions)
    still = replace(
        clip,
        rotations_local=clip.rotations_local[-1:].expand(30, -1, -1),
        root_positions=clip.root_positions[-1:].expand(30, -1),
        tracks={},
    )
    _assert_same_motion(forecast.cut(50, 80), still)


def test_joints_the_predictor_does_not_know_are_folded_away_and_come_back() -> None:
    whole = _clip(25.0, 60)
    wanted = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1))
    world = forward_kinematics(SKELETON, whole.rotations_local, whole.offsets, whole.root_positions)
    reduced = replace(
        whole,
        skeleton=wanted,
        offsets=whole.offsets[[1, 2, 4]],
        root_positions=world.positions[:, 1],
        rotations_local=torch.stack(
            [
                world.rotations[:, 1],
                whole.rotations_local[:, 2],
                quaternion.product(whole.rotations_local[:, 3], whole.rotations_local[:, 4]),
            ],
            dim=1,
        ),
        tracks={},
    )
    # Reference travels, so the part of it that the forecast does not continue is its last place.
    forecast = forecast_clip(
        Oracle(reduced), whole.cut(0, 40), skeleton=wanted, fps=25.0, horizon_ms=400
    )
    assert forecast.skeleton == SKELETON
    assert forecast.translations_local is not None
    found = forward_kinematics(
        SKELETON, forecast.rotations_local, forecast.translations_local, forecast.root_positions
    )
    torch.testing.assert_close(found.positions[:50, 1:], world.positions[:50, 1:])
    angle = quaternion.angle(found.rotations[:50, 1:], world.rotations[:50, 1:])
    assert float(angle.max()) < 1e-7


def test_only_the_prefix_that_was_asked_for_is_read() -> None:
    clip = _clip(25.0, 60)
    seen: list[int] = []

    class Counting(ZeroVelocity):
        def predict(self, prefix: Motion, horizon: int) -> Motion:
            seen.append(prefix.root_positions.shape[1])
            return super().predict(prefix, horizon)

    forecast_clip(Counting(), clip, skeleton=SKELETON, fps=25.0, horizon_ms=400, prefix=50)
    assert seen == [50]


def test_missing_joints_are_named() -> None:
    with pytest.raises(SkeletonError, match=r"lacks 1 of 2 joints: Tail; it has besides: Hips"):
        match_joints(Skeleton(("Root", "Hips"), (-1, 0)), Skeleton(("Root", "Tail"), (-1, 0)))


def test_renamed_joints_are_guessed_and_a_mapping_brings_them_together() -> None:
    clip = _clip(25.0, 20)
    theirs = Skeleton(
        ("mixamorig:Reference", "mixamorig:Hips", "spine_", "Helper", "Kopf"),
        clip.skeleton.parents,
    )
    named = replace(clip, skeleton=theirs)
    wanted = clip.skeleton
    with pytest.raises(SkeletonError) as caught:
        match_joints(theirs, wanted)
    said = str(caught.value)
    assert "lacks 4 of 5 joints: Reference, Hips, Spine, Head" in said
    assert "besides: mixamorig:Reference, mixamorig:Hips, spine_, Kopf" in said
    assert "perhaps renamed: Reference: mixamorig:Reference; Hips: mixamorig:Hips" in said
    assert "Spine: spine_;" in said
    assert "--mapping FILE" in said
    names = {
        "Reference": "mixamorig:Reference",
        "Hips": "mixamorig:Hips",
        "Spine": "spine_",
        "Head": "Kopf",
    }
    renamed = rename_joints(named, names)
    assert match_joints(renamed.skeleton, wanted) == (0, 1, 2, 3, 4)
    back = rename_joints(renamed, {old: new for new, old in names.items()})
    assert back.skeleton == theirs


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"Pelvis": "Hip"}, "names joint 'Hip', which the clip does not have; did you mean 'Hips'"),
        ({"A": "Hips", "B": "Hips"}, "gives one joint of the clip two names"),
        ({"Spine": "Hips"}, "two joints of the clip are called 'Spine'"),
    ],
)
def test_a_wrong_mapping_says_what_is_wrong(names: dict[str, str], said: str) -> None:
    with pytest.raises(SkeletonError, match=said):
        rename_joints(_clip(25.0, 5), names)


def test_another_tree_over_the_same_joints_is_refused() -> None:
    with pytest.raises(SkeletonError, match="another order or tree"):
        match_joints(Skeleton(("a", "b", "c"), (-1, 0, 0)), Skeleton(("a", "b", "c"), (-1, 0, 1)))


@pytest.mark.parametrize("horizon_ms", [0.0, -100.0, 10.0, float("nan"), float("inf")])
def test_a_horizon_without_a_frame_is_refused(horizon_ms: float) -> None:
    with pytest.raises(ConfigError, match="is shorter than a frame of 40 ms"):
        forecast_clip(
            ZeroVelocity(),
            _clip(25.0, 10),
            skeleton=SKELETON,
            fps=25.0,
            horizon_ms=horizon_ms,
        )


def test_a_clip_too_short_to_start_from_is_refused() -> None:
    with pytest.raises(DataError, match="two"):
        forecast_clip(ZeroVelocity(), _clip(25.0, 1), skeleton=SKELETON, fps=25.0, horizon_ms=400)
    with pytest.raises(DataError, match=r"two frames, 0\.08 s"):
        forecast_clip(ZeroVelocity(), _clip(100.0, 3), skeleton=SKELETON, fps=25.0, horizon_ms=400)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "turning: rotations_local has a quaternion of length 0 in frame 9, joint 'Spine'"),
        (float("nan"), "turning: rotations_local has a value that is not finite in row 9"),
    ],
)
def test_a_clip_with_numbers_that_are_no_motion_is_refused(value: float, said: str) -> None:
    clip = _clip(25.0, 10)
    rotations = clip.rotations_local.clone()
    rotations[-1, 2] = value
    broken = replace(clip, rotations_local=rotations)
    with pytest.raises(DataError, match=said):
        forecast_clip(ZeroVelocity(), broken, skeleton=SKELETON, fps=25.0, horizon_ms=200)

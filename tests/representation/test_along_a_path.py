"""The codec along a path: a root seen from its place, controls, signs that are kept."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.motion.tracks import (
    FACING,
    LATERAL,
    LONGITUDINAL,
    MOVEMENT,
    PATH,
    PHASE,
    SPEED,
    STYLE,
    left_of,
    mirrored,
    turned,
)
from posecast.representation import Codec, Controls, Quaternion
from posecast.skeleton import Skeleton
from posecast.training import augmentation

SKELETON = Skeleton(("hips", "left_leg", "right_leg"), (-1, 0, 0))


@pytest.fixture
def motion(generator) -> Motion:
    """Two walks of nine frames whose root is where its tracks say."""

    def drawn(*shape):
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    angle = drawn(2, 9)
    movement = torch.stack([angle.sin(), angle.cos()], dim=-1)
    tracks = {
        PATH: drawn(2, 9, 2),
        MOVEMENT: movement,
        LONGITUDINAL: drawn(2, 9),
        LATERAL: drawn(2, 9),
        PHASE: drawn(2, 9),
        SPEED: drawn(2, 9).abs(),
        FACING: torch.nn.functional.normalize(drawn(2, 9, 2), dim=-1),
        STYLE: torch.eye(2, dtype=torch.float64)[[0, 1]][:, None].expand(-1, 9, -1),
    }
    floor = (
        tracks[PATH]
        + tracks[LONGITUDINAL][..., None] * movement
        + tracks[LATERAL][..., None] * left_of(movement)
    )
    return Motion(
        rotations_local=quaternion.normalize(drawn(2, 9, 3, 4)),
        root_positions=torch.stack([floor[..., 0], drawn(2, 9), floor[..., 1]], dim=-1),
        offsets=drawn(2, 3, 3),
        tracks=tracks,
    )


def codec(root="path_lateral", **options) -> Codec:
    return Codec(SKELETON, Quaternion(), root=root, **options)


def test_the_root_is_written_as_seen_from_its_place(motion):
    root = codec().split(codec().encode(motion)).root
    torch.testing.assert_close(root[..., 0], motion.tracks[LONGITUDINAL])
    torch.testing.assert_close(root[..., 1], motion.root_positions[..., 1])
    torch.testing.assert_close(root[..., 2], motion.tracks[LATERAL])
    published = codec("path").split(codec("path").encode(motion)).root
    torch.testing.assert_close(published, root[..., :2])


def test_a_root_that_is_read_back_is_where_it_was(motion):
    written = codec()
    found = written.decode(
        written.encode(motion),
        offsets=motion.offsets,
        anchor=torch.zeros(2, 3, dtype=torch.float64),
        tracks=motion.tracks,
    )
    torch.testing.assert_close(found.root_positions, motion.root_positions)


def test_without_its_path_a_root_stays_above_its_anchor(motion):
    written, anchor = codec("path"), torch.tensor([[1.0, 5.0, 2.0], [3.0, 5.0, 4.0]]).double()
    found = written.decode(written.encode(motion), offsets=motion.offsets, anchor=anchor)
    torch.testing.assert_close(found.root_positions[..., 1], motion.root_positions[..., 1])
    expected = anchor[:, None, [0, 2]].expand(-1, 9, -1)
    torch.testing.assert_close(found.root_positions[..., [0, 2]], expected)


@pytest.mark.parametrize(("root", "lacks"), [("path", LONGITUDINAL), ("path_lateral", LATERAL)])
def test_a_root_along_a_path_needs_its_tracks(motion, root, lacks):
    tracks = {name: values for name, values in motion.tracks.items() if name != lacks}
    with pytest.raises(ConfigError, match=f"lacks {lacks}: analyse its gait first"):
        codec(root).encode(motion._replace(tracks=tracks))
    with pytest.raises(ConfigError, match="analyse its gait first"):
        codec(root).encode(motion._replace(tracks=None))


def test_roots_along_a_path_keep_the_sign_they_begin_with(motion):
    first = torch.tensor([[1.0, -1.0], [-1.0, 1.0]]).double()
    signs = torch.ones(2, 1, 3, 1, dtype=torch.float64)
    for change in (first[0], first[1]):
        signs[:, 0, 0, 0] = change
        flipped = motion._replace(rotations_local=motion.rotations_local * signs)
        joints = codec().split(codec().encode(flipped)).joints
        torch.testing.assert_close(joints[:, 0, 0], flipped.rotations_local[:, 0, 0])
        assert (joints[:, 0, 1:, 0] >= 0).all()
        assert ((joints[:, 1:] * joints[:, :-1]).sum(-1) >= 0).all()


def test_controls_are_step_movement_facing_and_style(motion):
    controls = Controls(styles=("calm", "wild")).encode(motion.tracks)
    assert controls.shape == (2, 9, 8)
    assert Controls(styles=("calm", "wild")).names == (
        *("step_cos", "step_sin", "movement_x", "movement_z", "facing_x", "facing_z"),
        *("style.calm", "style.wild"),
    )
    speed, phase = motion.tracks[SPEED], motion.tracks[PHASE]
    torch.testing.assert_close(controls[..., 0], speed * torch.cos(phase))
    torch.testing.assert_close(controls[..., 1], speed * torch.sin(phase))
    torch.testing.assert_close(controls[..., 2:4], speed[..., None] * motion.tracks[MOVEMENT])
    torch.testing.assert_close(controls[..., 4:6], motion.tracks[FACING])
    torch.testing.assert_close(controls[..., 6:], motion.tracks[STYLE])


def test_the_direction_of_movement_may_leave_the_speed_out(motion):
    controls = Controls(movement="unit")
    assert controls.dim == 6
    torch.testing.assert_close(controls.encode(motion.tracks)[..., 2:4], motion.tracks[MOVEMENT])


def test_a_codec_names_the_tracks_it_reads_and_steers_by_them(motion):
    steered = codec(controls=Controls(styles=("calm", "wild")))
    assert steered.tracks == (LONGITUDINAL, LATERAL, PHASE, SPEED, MOVEMENT, FACING, STYLE)
    torch.testing.assert_close(steered.steer(motion), steered.controls.encode(motion.tracks))
    assert codec().steer(motion) is None
    assert codec("path").tracks == (LONGITUDINAL,)
    assert codec("none").tracks == ()


def test_controls_of_a_motion_that_was_not_analysed_are_refused(motion):
    with pytest.raises(ConfigError, match="lacks phase, speed, movement, facing: analyse its gait"):
        codec(controls=Controls()).steer(motion._replace(tracks={STYLE: motion.tracks[STYLE]}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"movement": "fast"}, "controls.movement: 'fast' is not known; choose 'scaled' or 'unit'"),
        ({"styles": ("calm", "calm")}, "controls.styles: 'calm' is there twice"),
    ],
)
def test_controls_that_make_no_sense_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        Controls(**options)


def test_turned_windows_are_written_the_same_but_for_the_root_and_directions(motion):
    angles = torch.tensor([0.7, -4.0], dtype=torch.float64)
    after = augmentation.turn(motion, angles, SKELETON)
    steered = codec(controls=Controls())
    torch.testing.assert_close(
        steered.split(steered.encode(after)).root, steered.split(steered.encode(motion)).root
    )
    torch.testing.assert_close(steered.steer(after)[..., :2], steered.steer(motion)[..., :2])
    found = steered.decode(
        steered.encode(after),
        offsets=after.offsets,
        anchor=angles.new_zeros(2, 3),
        tracks=after.tracks,
    )
    torch.testing.assert_close(found.root_positions, after.root_positions)
    x, z = motion.tracks[FACING][0, 0].tolist()
    expected = [math.cos(0.7) * x + math.sin(0.7) * z, math.cos(0.7) * z - math.sin(0.7) * x]
    assert after.tracks[FACING][0, 0].tolist() == pytest.approx(expected)


def test_mirrored_windows_step_with_the_other_foot_on_the_other_side(motion):
    chosen = torch.tensor([True, False])
    after = augmentation.mirror(motion, chosen, SKELETON)
    steered = codec(controls=Controls())
    torch.testing.assert_close(after.tracks[LATERAL][0], -motion.tracks[LATERAL][0])
    torch.testing.assert_close(steered.steer(after)[0, :, :2], -steered.steer(motion)[0, :, :2])
    torch.testing.assert_close(steered.steer(after)[1], steered.steer(motion)[1])
    found = steered.decode(
        steered.encode(after),
        offsets=after.offsets,
        anchor=torch.zeros(2, 3, dtype=torch.float64),
        tracks=after.tracks,
    )
    torch.testing.assert_close(found.root_positions, after.root_positions)


def test_mirroring_undoes_itself_and_turning_back_does(motion):
    again = mirrored(mirrored(motion.tracks))
    back = turned(turned(motion.tracks, 1.3), -1.3)
    for name, values in motion.tracks.items():
        torch.testing.assert_close(back[name], values)
        if name == PHASE:
            torch.testing.assert_close(again[name].cos(), values.cos())
            torch.testing.assert_close(again[name].sin(), values.sin())
        else:
            torch.testing.assert_close(again[name], values)

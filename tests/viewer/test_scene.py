"""Scenes: upright, to scale, on the floor, and never outside the frame."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch

from posecast.errors import ConfigError, DataError
from posecast.motion import Clip
from posecast.skeleton import Skeleton
from posecast.viewer.canvas import new_figure
from posecast.viewer.figure import Panel, Stage, frame_count
from posecast.viewer.scene import facing, figure_of, frame_bounds, grid_lines, grid_step, look


@pytest.mark.parametrize("speed", [0.01, 0.2, 20.0])
@pytest.mark.parametrize("camera", ["auto", "fixed", "follow"])
def test_every_joint_of_every_frame_lies_inside_the_axes(wander, camera, speed):
    clips = [wander(1, speed=speed), wander(2, frames=40), wander(3, frames=1)]
    stage = Stage([figure_of(clip, camera) for clip in clips], look(0.7, 0.2), "abc", None)
    axes = [new_figure(400, 300).add_axes((0, 0, 1, 1)) for _ in clips]
    panels = [Panel(stage, index, place) for index, place in enumerate(axes)]
    checked = 0
    for frame in range(frame_count(stage.duration, 50.0)):
        for panel in panels:
            panel.show(frame / 50)
            left, right = panel.axes.get_xlim()
            bottom, top = panel.axes.get_ylim()
            points = np.concatenate([*panel.body.get_segments(), *panel.shadow.get_segments()])
            assert points.shape == (20, 2)
            assert ((left < points[:, 0]) & (points[:, 0] < right)).all()
            assert ((bottom < points[:, 1]) & (points[:, 1] < top)).all()
            checked += 1
    assert checked == 3 * (59 * 2 + 1)


def test_the_frame_is_not_larger_than_it_must_be(wander):
    figures = [figure_of(wander(1), "fixed")]
    view = look(0.3, 0.1)
    bounds = frame_bounds(figures, view)
    pose = [figures[0].pose(frame / 25) for frame in range(60)]
    points = np.concatenate([view.flat(each.joints) for each in pose])
    room = 0.06 * max(bounds.width, bounds.height) + 0.01
    assert points[:, 0].min() - bounds.left < room
    assert bounds.right - points[:, 0].max() < room
    assert bounds.top - points[:, 1].max() < room


def test_a_panel_has_the_same_scale_in_both_directions(wander):
    stage = Stage([figure_of(wander(1), "fixed")], look(0.7, 0.2), ["a"], None)
    panel = Panel(stage, 0, new_figure(500, 200).add_axes((0, 0, 1, 1)))
    panel.axes.figure.canvas.draw()
    corner = panel.axes.transData.transform([(0, 0), (1, 1)])
    across, up = corner[1] - corner[0]
    assert across == pytest.approx(up, rel=1e-9)


def test_y_is_up_and_the_left_side_of_one_who_faces_us_is_on_our_right(stand):
    view = look(0.0, 0.2)
    pose = figure_of(stand(), "fixed").pose(0.0)
    flat = view.flat(pose.joints)
    names = stand().skeleton.names
    assert flat[names.index("Head"), 1] > flat[names.index("Hips"), 1] > flat[2, 1]
    assert flat[names.index("LeftFoot"), 0] > 0 > flat[names.index("RightFoot"), 0]
    axes = np.stack([view.across, view.up, view.toward])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5, math.pi - 0.01])
def test_the_camera_finds_where_a_body_faces(stand, heading):
    assert facing(stand(heading=heading)) == pytest.approx(heading, abs=1e-6)


def test_the_feet_of_one_who_stands_are_on_the_floor(stand):
    pose = figure_of(stand(), "fixed").pose(0.4)
    np.testing.assert_allclose(pose.joints[[2, 4], 1], 0, atol=1e-12)
    np.testing.assert_allclose(pose.shadow([(1, 2)])[..., 1], 0)


def test_a_body_that_travels_far_is_followed_and_one_that_stays_is_not(stand):
    clip = stand(frames=100)
    near, far = (clip.root_positions.clone() for _ in range(2))
    near[:, 2] += torch.linspace(0, 1.0, 100, dtype=torch.float64)
    far[:, 2] += torch.linspace(0, 9.0, 100, dtype=torch.float64)
    still = figure_of(dataclasses.replace(clip, root_positions=near), "auto")
    moving = figure_of(dataclasses.replace(clip, root_positions=far), "auto")
    assert np.ptp(still.center[:, 1]) == 0
    assert np.ptp(moving.center[:, 1]) > 8
    for time in (0.0, 2.0, 99 / 25):
        # A steady walk is followed exactly, up to its ends.
        assert moving.pose(time).joints[:, 2].mean() == pytest.approx(0, abs=1e-6)


def test_times_between_frames_are_interpolated_and_after_the_end_the_body_rests(wander):
    figure = figure_of(wander(1), "fixed")
    between = (figure.pose(0.04).joints + figure.pose(0.08).joints) / 2
    np.testing.assert_allclose(figure.pose(0.06).joints, between, atol=1e-12)
    np.testing.assert_allclose(figure.pose(99.0).joints, figure.pose(59 / 25).joints)


def test_limbs_take_the_side_of_their_name_and_of_what_they_hang_from(stand):
    figure = figure_of(stand(), "fixed")
    sides = dict(zip(figure.bones, figure.sides, strict=True))
    assert sides == {
        (0, 1): "left",
        (1, 2): "left",
        (0, 3): "right",
        (3, 4): "right",
        (0, 5): "middle",
    }


def test_a_root_that_only_carries_the_body_is_not_drawn(stand):
    inner = stand(frames=50)
    skeleton = Skeleton(
        ("Carrier", *inner.skeleton.names), (-1, *(parent + 1 for parent in inner.skeleton.parents))
    )
    moved = torch.zeros(50, 7, 3, dtype=torch.float64)
    moved[:, 1:] = inner.offsets
    moved[:, 1, 0] = torch.linspace(5, 9, 50)
    moved[:, 1, 1] = 0.9
    rotations = torch.cat([inner.rotations_local[:, :1], inner.rotations_local], dim=1)
    root = torch.zeros(50, 3, dtype=torch.float64)
    clip = Clip(skeleton, moved[0], 25.0, root, rotations, translations_local=moved)
    figure = figure_of(clip, "follow")
    assert (0, 1) not in figure.bones
    assert len(figure.bones) == 5
    bounds = frame_bounds([figure], look(0.0, 0.0))
    assert bounds.width < 2


def test_the_grid_rests_in_the_world_while_the_camera_moves():
    here = grid_lines(np.array([0.2, 0.0]), 2.0)
    there = grid_lines(np.array([0.3, 0.0]), 2.0)
    across = {round(float(line[0, 0]), 9) for line in here if line[0, 0] == line[1, 0]}
    moved = {round(float(line[0, 0]), 9) for line in there if line[0, 0] == line[1, 0]}
    assert len(across) == 8
    assert moved == {round(place - 0.1, 9) for place in across}


@pytest.mark.parametrize("reach", [1.0, 19.0, 21.0, 1e4])
def test_the_grid_is_never_a_forest_of_lines(reach):
    lines = grid_lines(np.array([0.13, -7.0]), reach)
    assert 2 <= len(lines) <= 2 * 81
    assert grid_step(reach) == {1.0: 0.5, 19.0: 0.5, 21.0: 1.0, 1e4: 256.0}[reach]


def test_positions_that_are_not_numbers_are_refused(stand):
    clip = stand()
    broken = clip.root_positions.clone()
    broken[3, 1] = math.nan
    with pytest.raises(DataError, match="stand: has positions that are not numbers"):
        figure_of(dataclasses.replace(clip, root_positions=broken), "fixed")


def test_a_clip_without_bones_is_refused(stand):
    clip = stand()
    alone = Clip(
        Skeleton(("Hips",), (-1,)),
        clip.offsets[:1],
        25.0,
        clip.root_positions,
        clip.rotations_local[:, :1],
        name="alone",
    )
    with pytest.raises(ConfigError, match="'alone' has no bones to draw"):
        figure_of(alone, "fixed")

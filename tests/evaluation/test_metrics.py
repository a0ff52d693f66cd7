"""Metrics: zero at equality, blind to what they claim to ignore, equal to slow references."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from posecast.errors import ConfigError
from posecast.evaluation import METRICS, FrameMetric
from posecast.evaluation.metric import Scene
from posecast.evaluation.pose_metrics import moving_angles
from posecast.geometry import quaternion
from posecast.motion.clip import Motion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("Hips", "Spine", "LeftLeg", "RightLeg", "Head"), (-1, 0, 0, 0, 1))
BLIND_TO_ROOT = ("euler", "euler_wrapped", "euler_all", "joint_angle", "position", "velocity")


def _motion(generator, frames=10, batch=3, scale=1.0) -> Motion:
    turns = scale * torch.randn(batch, frames, 5, 3, dtype=torch.float64, generator=generator)
    return Motion(
        quaternion.exp(turns),
        torch.randn(batch, frames, 3, dtype=torch.float64, generator=generator),
        torch.randn(batch, 5, 3, dtype=torch.float64, generator=generator),
    )


# Of these the prediction alone, or the truth alone, makes the value.
ONE_SIDED = (
    *(
        f"acceleration{what}{ending}"
        for what in ("", "_true")
        for ending in ("", "_cmu", "_with_prefix", "_with_prefix_cmu")
    ),
    *("jitter", "jitter_true"),
)


def _scene(target: Motion) -> Scene:
    known = target.cut(0, 4)
    return Scene(SKELETON, 25.0, known, replayed=known.cut(1))


def _frames(name: str, least: int = 1) -> range:
    """Horizons that a metric has values at."""
    return range(max(least, METRICS[name].least_frames), 11)


def _angles(rotations: torch.Tensor) -> np.ndarray:
    """z-y-x angles below the root by SciPy, one vector a frame."""
    below = rotations[..., 1:, [1, 2, 3, 0]].numpy()
    angles = Rotation.from_quat(below.reshape(-1, 4)).as_euler("ZYX")
    return angles.reshape(*rotations.shape[:2], -1)


def test_there_are_as_many_metrics_as_documented():
    assert len(METRICS) == 36
    assert all(name == metric.name for name, metric in METRICS.items())


SCORES = ("pck_auc",)
"""Of these more is better, and 1 is everything."""

IN_THIGHS = [name for name, metric in METRICS.items() if "thigh" in metric.asks]


@pytest.mark.parametrize("name", [name for name in METRICS if name not in (*ONE_SIDED, *SCORES)])
def test_a_metric_is_zero_at_equality(name, generator):
    target, frames = _motion(generator), _frames(name, 2)
    values = METRICS[name].values(target, target, _scene(target), frames)
    # The first frame is left out: its velocity depends on the prefix, which is the target's own.
    still = torch.zeros(3, len(frames), dtype=torch.float64)
    torch.testing.assert_close(values, still, atol=1e-7, rtol=0)


@pytest.mark.parametrize("name", METRICS)
def test_a_metric_does_not_care_for_the_sign_of_quaternions(name, generator):
    target, predicted = _motion(generator), _motion(generator)
    flips = torch.where(torch.rand(3, 10, 5, 1, generator=generator) < 0.5, 1.0, -1.0).double()
    flipped = predicted._replace(rotations_local=predicted.rotations_local * flips)
    frames, scene = _frames(name), _scene(target)
    torch.testing.assert_close(
        METRICS[name].values(flipped, target, scene, frames),
        METRICS[name].values(predicted, target, scene, frames),
    )


@pytest.mark.parametrize("name", BLIND_TO_ROOT)
def test_where_the_body_is_and_faces_does_not_count(name, generator):
    target, predicted, other = (_motion(generator) for _ in range(3))
    turned = predicted.rotations_local.clone()
    turned[..., 0, :] = other.rotations_local[..., 0, :]
    moved = Motion(turned, other.root_positions, predicted.offsets)
    frames, scene = range(1, 11), _scene(target)
    torch.testing.assert_close(
        METRICS[name].values(moved, target, scene, frames),
        METRICS[name].values(predicted, target, scene, frames),
    )


@pytest.mark.parametrize("name", METRICS)
def test_where_prediction_and_truth_are_together_does_not_count(name, generator):
    target, predicted = _motion(generator), _motion(generator)
    away = torch.randn(3, 1, 3, dtype=torch.float64, generator=generator)
    scene = _scene(target)
    moved = [
        motion._replace(root_positions=motion.root_positions + away)
        for motion in (predicted, target, scene.prefix, scene.replayed)
    ]
    elsewhere = scene._replace(prefix=moved[2], replayed=moved[3])
    torch.testing.assert_close(
        METRICS[name].values(moved[0], moved[1], elsewhere, _frames(name)),
        METRICS[name].values(predicted, target, scene, _frames(name)),
    )


# These look at joints where the network put them.
AS_PUT = ("emitted_cm", "bone_length_drift", "jitter")


@pytest.mark.parametrize("name", METRICS)
def test_only_metrics_of_what_was_emitted_see_that_bones_stretch(name, generator):
    target, rigid = _motion(generator), _motion(generator)
    bones = torch.randn(3, 10, 5, 3, dtype=torch.float64, generator=generator)
    stretched = rigid._replace(translations_local=bones)
    again = rigid.cut(1, 4)
    frames, scene = _frames(name), _scene(target)._replace(replayed=again)
    seen = METRICS[name].values(rigid, target, scene, frames)
    stretching = scene._replace(replayed=again._replace(translations_local=bones[:, 1:4]))
    found = METRICS[name].values(stretched, target, stretching, frames)
    assert torch.allclose(found, seen) == (name not in AS_PUT)


@pytest.mark.parametrize("name", METRICS)
def test_neither_rest_nor_noise_nor_no_body_at_all_makes_a_value_that_is_no_number(name, generator):
    target = _motion(generator)
    pose = target.rotations_local[:, :1].expand(-1, 10, -1, -1)
    rest = target._replace(rotations_local=pose)
    dot = target._replace(offsets=torch.zeros_like(target.offsets))
    pairs = [(rest, target), (target, rest), (rest, rest), (dot, dot), (dot, rest)]
    if name in IN_THIGHS:
        with pytest.raises(ConfigError, match="'LeftLeg' has no length"):
            METRICS[name].values(dot, dot, _scene(dot), _frames(name))
        pairs = [(predicted, true) for predicted, true in pairs if true is not dot]
    for predicted, true in pairs:
        values = METRICS[name].values(predicted, true, _scene(true), _frames(name))
        assert bool(torch.isfinite(values).all())
        assert values.shape == (3, len(_frames(name)))


@pytest.mark.parametrize("name", METRICS)
def test_the_value_at_a_horizon_does_not_depend_on_the_horizons_beside_it(name, generator):
    target, predicted = _motion(generator), _motion(generator)
    scene, frames = _scene(target), _frames(name)
    whole = METRICS[name].values(predicted, target, scene, frames)
    alone = METRICS[name].values(predicted, target, scene, frames[-3:-2])
    torch.testing.assert_close(alone[:, 0], whole[:, -3])


@pytest.mark.parametrize("name", BLIND_TO_ROOT)
def test_every_joint_that_is_not_listed_as_left_out_counts(name, generator):
    target = _motion(generator, scale=0.5)
    scene, metric = _scene(target), METRICS[name]
    left_out = metric.left_out(SKELETON)
    assert left_out == ("Hips",)
    checked = 0
    for joint, joint_name in enumerate(SKELETON.names):
        if joint_name in left_out or (
            name in ("position", "velocity") and not SKELETON.children[joint]
        ):
            continue  # a leaf's rotation moves no joint
        wrong = target.rotations_local.clone()
        turn = quaternion.exp(torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64))
        wrong[..., joint, :] = quaternion.product(wrong[..., joint, :], turn)
        values = metric.values(target._replace(rotations_local=wrong), target, scene, [10])
        assert bool((values > 1e-3).all()), joint_name
        checked += 1
    assert checked == (1 if name in ("position", "velocity") else 4)


def test_the_euler_error_is_an_unwrapped_norm_over_all_angles_below_the_root(generator):
    target, predicted = _motion(generator), _motion(generator)
    difference = _angles(predicted.rotations_local) - _angles(target.rotations_local)
    assert np.abs(difference).max() > math.pi  # or wrapping would change nothing
    frames, scene = range(1, 11), _scene(target)
    for name in ("euler", "euler_all"):
        found = METRICS[name].values(predicted, target, scene, frames)
        np.testing.assert_allclose(found, np.linalg.norm(difference, axis=-1), atol=1e-10)
    wrapped = (difference + math.pi) % (2 * math.pi) - math.pi
    found = METRICS["euler_wrapped"].values(predicted, target, scene, frames)
    np.testing.assert_allclose(found, np.linalg.norm(wrapped, axis=-1), atol=1e-10)


def test_angles_that_rest_in_the_target_do_not_count_however_wrong(generator):
    target, predicted = _motion(generator), _motion(generator)
    still = target.rotations_local.clone()
    still[:, :, 2] = still[:, :1, 2]
    target = target._replace(rotations_local=still)
    difference = _angles(predicted.rotations_local) - _angles(target.rotations_local)
    rest = np.delete(difference, [3, 4, 5], axis=-1)
    frames, scene = range(1, 11), _scene(target)
    found = METRICS["euler"].values(predicted, target, scene, frames)
    np.testing.assert_allclose(found, np.linalg.norm(rest, axis=-1), atol=1e-10)
    everything = METRICS["euler_all"].values(predicted, target, scene, frames)
    assert bool((everything > found).all())


def test_a_prediction_that_rests_is_not_excused(generator):
    target = _motion(generator)
    still = target.rotations_local[:, :1].expand(-1, 10, -1, -1)
    values = METRICS["euler"].values(
        target._replace(rotations_local=still), target, _scene(target), range(2, 11)
    )
    assert bool((values > 0.1).all())


def test_which_angles_move_is_decided_window_by_window_with_the_population_deviation():
    target = torch.zeros(2, 10, 3, dtype=torch.float64)
    ramp = torch.arange(10, dtype=torch.float64)
    target[0, :, 1] = ramp * (1.01e-4 / ramp.std(correction=0))
    target[1, :, 2] = ramp * (0.99e-4 / ramp.std(correction=0))
    moving = moving_angles(target)
    assert moving.tolist() == [[[False, True, False]], [[False, False, False]]]


def test_a_turn_of_one_joint_counts_for_every_joint_below_it(generator):
    target = _motion(generator)
    wrong = target.rotations_local.clone()
    turn = quaternion.exp(torch.tensor([0.0, 0.4, 0.0], dtype=torch.float64))
    wrong[..., 1, :] = quaternion.product(wrong[..., 1, :], turn)
    values = METRICS["joint_angle"].values(
        target._replace(rotations_local=wrong), target, _scene(target), [1, 10]
    )
    # Spine and Head below it are off by 0.4 rad, the two legs are right: mean over four.
    torch.testing.assert_close(values, torch.full_like(values, 0.2))


def test_position_is_the_mean_distance_below_the_root_in_meters(generator):
    target, predicted = _motion(generator), _motion(generator)
    distances = []
    for motion in (predicted, target):
        spine = Rotation.from_quat(motion.rotations_local[..., 1, [1, 2, 3, 0]].reshape(-1, 4))
        offset = target.offsets[:, None].expand(-1, 10, -1, -1).reshape(-1, 5, 3).numpy()
        head = offset[:, 1] + spine.apply(offset[:, 4])
        distances.append(head)
    # With the root at rest only the Head moves; four joints count.
    expected = np.linalg.norm(distances[0] - distances[1], axis=-1).reshape(3, 10) / 4
    found = METRICS["position"].values(predicted, target, _scene(target), range(1, 11))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_velocity_starts_from_the_last_true_frame_and_is_per_second(generator):
    target = _motion(generator)
    prefix = _motion(generator, frames=2)._replace(offsets=target.offsets)
    scene = Scene(SKELETON, 25.0, prefix)
    still = prefix.rotations_local[:, -1:].expand(-1, 10, -1, -1)
    predicted = target._replace(rotations_local=still)
    found = METRICS["velocity"].values(predicted, target, scene, [1])
    distance = METRICS["position"].values(predicted, target, scene, [1])
    torch.testing.assert_close(found, 25 * distance)


@pytest.mark.parametrize(
    ("span", "expected"),
    [("at", [[2.0, 4.0]]), ("sum", [[3.0, 10.0]]), ("mean", [[1.5, 2.5]])],
)
def test_a_metric_reports_at_or_until_the_horizon(span, expected, generator):
    values = torch.arange(1.0, 6.0)[None]
    metric = FrameMetric("toy", "Toy", "m", lambda *_: values, span=span)
    motion = _motion(generator)
    found = metric.values(motion, motion, _scene(motion), [2, 4])
    assert found.tolist() == expected

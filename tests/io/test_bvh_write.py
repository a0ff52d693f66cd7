"""What is written is read again as it was, in the conventions of the source, and twice alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.io.bvh_texts import DIALECTS, ROOT, TURNS, body, channels, motion, numbers
from tests.io.test_bvh_dialects import layout_of, world, write

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.geometry.euler import ORDERS, euler_to_quaternion
from posecast.io.amass import read_amass
from posecast.io.bvh import (
    BvhDocument,
    BvhJoint,
    read_bvh,
    read_bvh_document,
    write_bvh,
    write_bvh_document,
)
from posecast.io.bvh_text import six_decimals
from posecast.motion import Clip
from posecast.motion.transforms import resample
from posecast.skeleton import Skeleton

SLACK_DEG, SLACK_UNITS = 1e-4, 1e-4


def turned_by(first: Clip, second: Clip) -> float:
    """Largest angle between the rotations of two clips, degrees."""
    a, b = first.rotations_local, second.rotations_local
    between = quaternion.product(quaternion.conjugate(a), b)
    angle = 2 * torch.atan2(between[..., 1:].norm(dim=-1), between[..., 0].abs())
    return float(torch.rad2deg(angle).max())


def random_clip(generator: torch.Generator, frames: int = 40) -> Clip:
    """Three joints that turn at random but smoothly, with whole turns and no conventions."""
    steps = torch.randn(frames, 3, 3, generator=generator, dtype=torch.float64)
    return Clip(
        skeleton=Skeleton(("Hips", "Left Arm", "Hand"), (-1, 0, 1)),
        offsets=torch.tensor([[0, 0, 0], [0.1, 0.45, 0], [0.3, 0, 0.01]], dtype=torch.float64),
        fps=30.0,
        root_positions=torch.randn(frames, 3, generator=generator, dtype=torch.float64),
        rotations_local=euler_to_quaternion((0.3 * steps).cumsum(dim=0), "zyx"),
    )


@pytest.mark.parametrize("name", DIALECTS)
def test_what_is_read_and_written_is_the_same_motion(name: str, tmp_path: Path) -> None:
    source = read_bvh(write(tmp_path, DIALECTS[name].content), unit=0.01, up="z")
    write_bvh(source, tmp_path / "first.bvh")
    again = read_bvh(tmp_path / "first.bvh", unit=0.01, up="z")
    assert again.skeleton == source.skeleton
    assert turned_by(source, again) < SLACK_DEG
    np.testing.assert_allclose(world(again), world(source), rtol=0, atol=SLACK_UNITS * 0.01)
    assert again.fps == source.fps


@pytest.mark.parametrize("name", DIALECTS)
def test_writing_twice_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    source = write(tmp_path, DIALECTS[name].content)
    write_bvh(read_bvh(source), tmp_path / "first.bvh")
    write_bvh(read_bvh(tmp_path / "first.bvh"), tmp_path / "second.bvh")
    assert (tmp_path / "first.bvh").read_bytes() == (tmp_path / "second.bvh").read_bytes()


@pytest.mark.parametrize("name", DIALECTS)
def test_conventions_are_those_of_the_source(name: str, tmp_path: Path) -> None:
    source = write(tmp_path, DIALECTS[name].content)
    notes = write_bvh(read_bvh(source), tmp_path / "written.bvh")
    before, after = read_bvh_document(source), read_bvh_document(tmp_path / "written.bvh")
    assert (after.encoding, after.newline) == (before.encoding, before.newline)
    assert after.frame_time == before.frame_time
    assert after.joints == before.joints
    assert notes == ()
    np.testing.assert_allclose(after.values, before.values, rtol=0, atol=0.51e-6)


@pytest.mark.parametrize("name", ["an axis twice", "four rotations"])
def test_channels_that_cannot_say_it_are_replaced_where_the_motion_is_another(
    name: str, tmp_path: Path
) -> None:
    source = read_bvh(write(tmp_path, DIALECTS[name].content), unit=0.01, up="y")
    backwards = replace(source, rotations_local=source.rotations_local.flip(0))
    (note,) = write_bvh(backwards, tmp_path / "written.bvh")
    assert "cannot say" in note
    again = read_bvh(tmp_path / "written.bvh", unit=0.01, up="y")
    assert turned_by(backwards, again) < SLACK_DEG


def rotations_by_name(first: Clip, second: Clip) -> float:
    """Largest angle between the rotations of joints with one name, degrees."""
    places = [second.skeleton.index(name) for name in first.skeleton.names]
    return turned_by(first, replace(first, rotations_local=second.rotations_local[:, places]))


def test_joints_in_any_order_are_written_depth_first(
    generator: torch.Generator, tmp_path: Path
) -> None:
    names, parents = ("h", "a", "b", "a2", "b2", "a3"), (-1, 0, 0, 1, 2, 3)
    turns = torch.randn(20, 6, 3, generator=generator, dtype=torch.float64)
    clip = Clip(
        skeleton=Skeleton(names, parents),
        offsets=torch.randn(6, 3, generator=generator, dtype=torch.float64),
        fps=30.0,
        root_positions=torch.randn(20, 3, generator=generator, dtype=torch.float64),
        rotations_local=quaternion.exp(turns),
    )
    (note,) = write_bvh(clip, tmp_path / "file.bvh")
    assert "depth first" in note
    again = read_bvh(tmp_path / "file.bvh", unit=0.01, up="y")
    assert again.skeleton.names == ("h", "a", "a2", "a3", "b", "b2")
    assert rotations_by_name(clip, again) < SLACK_DEG
    assert write_bvh(again, tmp_path / "second.bvh") == ()
    assert (tmp_path / "file.bvh").read_bytes() == (tmp_path / "second.bvh").read_bytes()


def test_smpl_motion_survives_bvh(generator: torch.Generator, tmp_path: Path) -> None:
    rest = torch.randn(24, 3, generator=generator, dtype=torch.float64)
    poses = torch.randn(5, 72, generator=generator).numpy()
    np.savez(tmp_path / "a.npz", poses=poses, trans=np.zeros((5, 3)), mocap_framerate=30.0)
    clip = read_amass(tmp_path / "a.npz", template=rest)
    write_bvh(clip, tmp_path / "a.bvh")
    again = read_bvh(tmp_path / "a.bvh", unit=0.01, up="y")
    assert rotations_by_name(clip, again) < SLACK_DEG
    places = [again.skeleton.index(name) for name in clip.skeleton.names]
    np.testing.assert_allclose(world(again)[:, places], world(clip), rtol=0, atol=1e-6)


def test_a_document_in_any_order_is_read_back_joint_by_joint(tmp_path: Path) -> None:
    turn = ("Xrotation",)
    joints = tuple(
        BvhJoint(name, parent, ("0", "1", "0"), turn)
        for name, parent in (("h", -1), ("a", 0), ("b", 0), ("a2", 1))
    )
    write_bvh_document(BvhDocument(joints, "0.04", np.array([[1.0, 2, 3, 4]])), tmp_path / "d.bvh")
    again = read_bvh_document(tmp_path / "d.bvh")
    found = {joint.name: value for joint, value in zip(again.joints, again.values[0], strict=True)}
    assert found == {"h": 1, "a": 2, "b": 3, "a2": 4}


@pytest.mark.parametrize(("start", "stop"), [(0, 3), (2, 5), (1, 4), (3, 4)])
def test_a_piece_cut_out_keeps_the_angles_of_its_frames(
    start: int, stop: int, tmp_path: Path
) -> None:
    source = wild(tmp_path, "zyx")
    write_bvh(read_bvh(source).cut(start, stop), tmp_path / "piece.bvh")
    before, after = read_bvh_document(source), read_bvh_document(tmp_path / "piece.bvh")
    expected = before.values[start:stop, 3:]
    np.testing.assert_allclose(after.values[:, 3:], expected, rtol=0, atol=1e-9)


WILD = np.array([[0, 10, 20], [350, 170, 200], [-700, 95, -20], [30, 90, 40], [30, -270, 999]])
"""Degrees that jump by whole turns, take either branch, and lock the gimbal."""


def wild(tmp_path: Path, order: str) -> Path:
    """A file whose angles nobody would choose."""
    spelled = " ".join(f"{axis.upper()}rotation" for axis in order)
    rows = np.hstack([np.ones((5, 3)), WILD, WILD[::-1], -WILD])
    text = [[f"{value:.6f}" for value in row] for row in rows]
    root = channels(f"Xposition Yposition Zposition {spelled}")
    hierarchy = body(root=root, arm=channels(spelled), hand=channels(spelled))
    return write(tmp_path, hierarchy + motion(text))


@pytest.mark.parametrize("order", ORDERS)
def test_angles_of_poses_that_did_not_change_are_those_of_the_source(
    order: str, tmp_path: Path
) -> None:
    source = wild(tmp_path, order)
    write_bvh(read_bvh(source).to(torch.float32), tmp_path / "written.bvh")
    before, after = read_bvh_document(source), read_bvh_document(tmp_path / "written.bvh")
    np.testing.assert_allclose(after.values[:, 3:], before.values[:, 3:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_what_follows_poses_of_the_source_goes_on_from_their_angles(
    order: str, tmp_path: Path
) -> None:
    clip = read_bvh(wild(tmp_path, order), unit=0.01, up="y")
    step = euler_to_quaternion(torch.tensor([0.01, 0.02, 0.03], dtype=torch.float64), order)
    further = quaternion.product(clip.rotations_local[1], step)
    longer = replace(
        clip,
        rotations_local=torch.stack([*clip.rotations_local[:2], further]),
        root_positions=clip.root_positions[:3],
    )
    write_bvh(longer, tmp_path / "written.bvh")
    values = read_bvh_document(tmp_path / "written.bvh").values[:, 3:]
    expected = np.hstack([WILD, WILD[::-1], -WILD])[:2]
    np.testing.assert_allclose(values[:2], expected, rtol=0, atol=1e-9)
    free = np.abs(np.sin(np.radians(values[1].reshape(3, 3)[:, 1])))
    locked = free < 0.2 if order[0] == order[2] else free > 0.98
    assert np.abs(values[2] - values[1]).reshape(3, 3)[~locked].max() < 15
    again = read_bvh(tmp_path / "written.bvh", unit=0.01, up="y")
    assert turned_by(longer, again) < SLACK_DEG


@pytest.mark.parametrize("order", ORDERS)
def test_angles_are_those_of_the_source_away_from_gimbal_lock(order: str, tmp_path: Path) -> None:
    rows = np.full((200, 12), 0.25)
    rows[:, 3:] = np.linspace(-1, 1, 200)[:, None] * np.linspace(200, 900, 9)
    rows[:, 4::3] = np.linspace(20, 70, 200)[:, None]
    text = [[f"{value:.6f}" for value in row] for row in rows]
    spelled = " ".join(f"{axis.upper()}rotation" for axis in order)
    root = channels(f"Xposition Yposition Zposition {spelled}")
    hierarchy = body(root=root, arm=channels(spelled), hand=channels(spelled))
    source = write(tmp_path, hierarchy + motion(text))
    write_bvh(read_bvh(source), tmp_path / "written.bvh")
    before, after = read_bvh_document(source), read_bvh_document(tmp_path / "written.bvh")
    np.testing.assert_allclose(after.values, before.values, rtol=0, atol=1.01e-6)


@pytest.mark.parametrize("order", ORDERS)
def test_gimbal_lock_is_passed_and_written_twice_alike(order: str, tmp_path: Path) -> None:
    lock = (0.0, 180.0, -180.0) if order[0] == order[2] else (90.0, -90.0, 270.0)
    rng = np.random.default_rng(1)
    rows = rng.uniform(-180, 180, (120, 12))
    near = np.concatenate([np.zeros(10), rng.normal(size=90) * 10.0 ** rng.uniform(-9, 1, 90)])
    for joint in range(3):
        rows[:100, 4 + 3 * joint] = lock[joint] + near
    spelled = " ".join(f"{axis.upper()}rotation" for axis in order)
    root = channels(f"Xposition Yposition Zposition {spelled}")
    hierarchy = body(root=root, arm=channels(spelled), hand=channels(spelled))
    text = [[f"{value:.12f}" for value in row] for row in rows]
    source = read_bvh(write(tmp_path, hierarchy + motion(text)))
    write_bvh(source, tmp_path / "first.bvh")
    again = read_bvh(tmp_path / "first.bvh")
    assert turned_by(source, again) < SLACK_DEG
    write_bvh(again, tmp_path / "second.bvh")
    assert (tmp_path / "first.bvh").read_bytes() == (tmp_path / "second.bvh").read_bytes()


def test_angles_are_continuous_in_time(generator: torch.Generator, tmp_path: Path) -> None:
    clip = random_clip(generator, frames=400)
    write_bvh(clip, tmp_path / "file.bvh")
    angles = read_bvh_document(tmp_path / "file.bvh").values[:, 3:]
    steps = np.abs(np.diff(angles, axis=0))
    assert steps.max() < 180
    assert np.abs(angles).max() > 360


def test_a_clip_without_a_source_is_written_in_centimetres(
    generator: torch.Generator, tmp_path: Path
) -> None:
    clip = random_clip(generator)
    assert write_bvh(clip, tmp_path / "file.bvh") == ()
    document = read_bvh_document(tmp_path / "file.bvh")
    assert [" ".join(joint.channels) for joint in document.joints] == [
        ROOT,
        *["Zrotation Yrotation Xrotation"] * 2,
    ]
    assert document.joints[1].offset == ("10.000000", "45.000000", "0.000000")
    assert [len(joint.ends) for joint in document.joints] == [0, 0, 1]
    again = read_bvh(tmp_path / "file.bvh", unit=0.01, up="y")
    assert again.skeleton == clip.skeleton
    assert again.fps == 30.0
    assert turned_by(clip, again) < SLACK_DEG
    np.testing.assert_allclose(world(again), world(clip), rtol=0, atol=SLACK_UNITS * 0.01)


def test_bones_that_move_get_position_channels(generator: torch.Generator, tmp_path: Path) -> None:
    still = random_clip(generator)
    moving = still.offsets.repeat(still.frames, 1, 1)
    moving[:, 2, 1] = torch.linspace(0, 0.5, still.frames)
    clip = replace(still, translations_local=moving)
    (note,) = write_bvh(clip, tmp_path / "file.bvh")
    assert "'Hand' moves" in note
    again = read_bvh(tmp_path / "file.bvh", unit=0.01, up="y")
    np.testing.assert_allclose(world(again), world(clip), rtol=0, atol=SLACK_UNITS * 0.01)


@pytest.mark.parametrize("spelled", ["Xrotation", "Xrotation Zrotation", ""])
def test_a_joint_with_too_few_channels_gets_three_and_a_note(
    spelled: str, generator: torch.Generator, tmp_path: Path
) -> None:
    hierarchy = body(arm=channels(spelled), names=("Hips", "Left Arm", "Hand"))
    columns = 9 + len(spelled.split())
    source = read_bvh(write(tmp_path, hierarchy + motion(numbers(columns))), unit=0.01, up="y")
    free = replace(random_clip(generator), source=source.source)
    (note,) = write_bvh(free, tmp_path / "first.bvh")
    assert "'Left Arm' turns in ways its channels" in note
    again = read_bvh(tmp_path / "first.bvh", unit=0.01, up="y")
    assert len(layout_of(again).joints[1].channels) == 3
    assert turned_by(free, again) < SLACK_DEG
    write_bvh(again, tmp_path / "second.bvh")
    assert (tmp_path / "first.bvh").read_bytes() == (tmp_path / "second.bvh").read_bytes()


def test_what_is_cut_or_continued_keeps_the_conventions(tmp_path: Path) -> None:
    source = read_bvh(write(tmp_path, DIALECTS["mixed orders"].content), unit=0.01, up="z")
    longer = replace(
        source.cut(1, 4),
        root_positions=source.root_positions[[1, 2, 3, 3, 2]],
        rotations_local=source.rotations_local[[1, 2, 3, 3, 2]],
    )
    assert write_bvh(longer, tmp_path / "longer.bvh") == ()
    whole, part = (
        read_bvh_document(tmp_path / "file.bvh"),
        read_bvh_document(tmp_path / "longer.bvh"),
    )
    assert part.joints == whole.joints
    assert part.frame_time == whole.frame_time
    apart = (part.values - whole.values[[1, 2, 3, 3, 2]])[:, :3]
    assert np.abs(apart).max() < 1.01e-6


def test_a_pruned_clip_keeps_what_it_can(tmp_path: Path) -> None:
    source = read_bvh(write(tmp_path, DIALECTS["mixed orders"].content), unit=0.01, up="y")
    pruned = replace(
        source,
        skeleton=Skeleton(("LeftArm", "LeftHand"), (-1, 0)),
        offsets=torch.stack([torch.zeros(3).double(), source.offsets[2]]),
        rotations_local=source.rotations_local[:, 1:],
    )
    (note,) = write_bvh(pruned, tmp_path / "pruned.bvh")
    assert "Xposition, Yposition, Zposition added" in note
    again = read_bvh(tmp_path / "pruned.bvh", unit=0.01, up="y")
    assert layout_of(again).joints[1].channels == layout_of(source).joints[2].channels
    np.testing.assert_allclose(world(again), world(pruned), rtol=0, atol=SLACK_UNITS * 0.01)


def test_another_body_is_written_with_its_own_offsets(tmp_path: Path) -> None:
    source = read_bvh(write(tmp_path, DIALECTS["plain"].content), unit=0.01, up="y")
    larger = replace(source, offsets=source.offsets * 1.5)
    write_bvh(larger, tmp_path / "larger.bvh")
    again = read_bvh(tmp_path / "larger.bvh", unit=0.01, up="y")
    torch.testing.assert_close(again.offsets, larger.offsets, rtol=0, atol=1e-8)


def test_another_frame_rate_is_written_at_full_precision(tmp_path: Path) -> None:
    source = read_bvh(write(tmp_path, body() + motion(numbers(12), time="0.008333")))
    (slow,) = resample(source, 29.97)
    write_bvh(slow, tmp_path / "slow.bvh")
    assert read_bvh_document(tmp_path / "slow.bvh").frame_time == repr(1 / 29.97)
    again = read_bvh(tmp_path / "slow.bvh")
    assert again.fps == pytest.approx(29.97, rel=1e-15)


def test_a_name_that_the_encoding_lacks_makes_the_file_utf8(tmp_path: Path) -> None:
    source = read_bvh(write(tmp_path, DIALECTS["Latin-1 names"].content), unit=0.01, up="y")
    names = ("Hüfte", "左腕", "a{b}\nc")
    renamed = replace(source, skeleton=Skeleton(names, source.skeleton.parents))
    write_bvh(renamed, tmp_path / "renamed.bvh")
    again = read_bvh(tmp_path / "renamed.bvh")
    assert again.skeleton.names == ("Hüfte", "左腕", "a_b_c")
    assert layout_of(again).encoding == "utf-8"


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e300])
def test_a_clip_that_is_not_finite_is_not_written(
    bad: float, generator: torch.Generator, tmp_path: Path
) -> None:
    clip = random_clip(generator)
    clip.root_positions[3, 1] = bad
    with pytest.raises(DataError, match="position that is not finite"):
        write_bvh(clip, tmp_path / "file.bvh")
    assert list(tmp_path.iterdir()) == []


def test_a_rotation_that_is_not_finite_is_not_written(
    generator: torch.Generator, tmp_path: Path
) -> None:
    clip = random_clip(generator)
    clip.rotations_local[3, 1] = float("nan")
    with pytest.raises(DataError, match="rotation that is not finite"):
        write_bvh(clip, tmp_path / "file.bvh")
    assert list(tmp_path.iterdir()) == []


def test_six_decimals_are_those_of_python() -> None:
    values = [0, 1, -1, 999_999, -1_000_000, 9_999_999_999, 10_000_000_000, -123_456_789_012_345]
    values += [4_294_967_295, 4_294_967_296, 99_999_999_999_999, -10_001_000_000, 2**52]
    for count in (5, 6, 9, 12, len(values)):
        micro = np.array([values[:count]], dtype=np.float64)
        expected = " ".join(f"{value / 1e6:.6f}" for value in values[:count])
        assert six_decimals(micro).decode() == expected + "\n"


def test_every_turn_is_found_with_channels_in_turn_order(tmp_path: Path) -> None:
    """A hinge that turns round and round stays a hinge."""
    rows = [["0"] * 6 + [f"{40 * frame}"] + ["0"] * 3 for frame in range(40)]
    source = write(tmp_path, body(arm=channels("Yrotation"), hand=channels(TURNS)) + motion(rows))
    assert write_bvh(read_bvh(source), tmp_path / "written.bvh") == ()
    after = read_bvh_document(tmp_path / "written.bvh").values
    np.testing.assert_allclose(after[:, 6], 40.0 * np.arange(40), rtol=0, atol=1.01e-6)

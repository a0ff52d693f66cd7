"""Small fabricated files in the formats of the named corpora."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from posecast.corpora.synthetic import make_clip
from posecast.geometry import quaternion
from posecast.io.bvh import write_bvh
from posecast.motion import Clip
from posecast.skeleton import Skeleton

ASF = """:version 1.10
:name TEST
:units
  mass 1.0
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name lfemur
     direction 0 -1 0
     length {length}
     axis 0 0 0 XYZ
     dof rx
     limits (-10.0 170.0)
  end
:hierarchy
  begin
    root lfemur
  end
"""


@pytest.fixture
def write_h36m(tmp_path: Path) -> Callable[..., Path]:
    """Write recordings of given lengths; each has its own numbers, drawn from a fixed seed."""

    def write(frames: dict[str, int] | Iterable[str], root: Path | None = None) -> Path:
        folder = root or tmp_path / "h36m"
        lengths = frames if isinstance(frames, dict) else dict.fromkeys(frames, 60)
        for number, (name, length) in enumerate(lengths.items()):
            values = np.random.default_rng(number).normal(0, 0.01, (length, 99))
            lines = [",".join(f"{value:.7f}" for value in row) for row in values]
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("\n".join(lines) + "\n")
        return folder

    return write


@pytest.fixture
def walk() -> Callable[..., Clip]:
    """A few seconds of a made-up adult who walks."""

    def make(index: int = 1, *, fps: float = 60.0, seconds: float = 4.0) -> Clip:
        return replace(make_clip(index, fps=fps, seconds=seconds), tracks={}, labels={})

    return make


@pytest.fixture
def write_walks(tmp_path: Path, walk: Callable[..., Clip]) -> Callable[..., Path]:
    """Write walks, each another, as BVH files in centimeters; returns the folder."""

    def write(
        names: Iterable[str],
        root: Path | None = None,
        change: Callable[[Clip], Clip] | None = None,
        **options: float,
    ) -> Path:
        folder = root or tmp_path / "walks"
        for number, name in enumerate(names):
            clip = walk(2 * number + 1, **options)
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_bvh(change(clip) if change else clip, folder / name)
        return folder

    return write


@pytest.fixture
def with_root_above() -> Callable[[Clip], Clip]:
    """Hang a clip from an unmoving ``joint_Root``, with position channels, as Bandai does."""

    def change(clip: Clip) -> Clip:
        skeleton = Skeleton(
            ("joint_Root", *clip.skeleton.names),
            (-1, *(parent + 1 for parent in clip.skeleton.parents)),
        )
        still = quaternion.identity(clip.frames, 1, like=clip.rotations_local)
        moved = clip.offsets.expand(clip.frames, -1, -1).clone()
        moved[:, 0] = clip.root_positions
        zero = torch.zeros(clip.frames, 1, 3, dtype=moved.dtype)
        return Clip(
            skeleton=skeleton,
            offsets=torch.cat([zero[0], clip.offsets]),
            fps=clip.fps,
            root_positions=torch.zeros_like(clip.root_positions),
            rotations_local=torch.cat([still, clip.rotations_local], dim=1),
            translations_local=torch.cat([zero, moved], dim=1),
        )

    return change


@pytest.fixture
def with_t_pose() -> Callable[[Clip], Clip]:
    """Put a T pose before the first frame."""

    def change(clip: Clip) -> Clip:
        still = quaternion.identity(1, len(clip.skeleton), like=clip.rotations_local)
        return replace(
            clip,
            root_positions=torch.cat([clip.root_positions[:1], clip.root_positions]),
            rotations_local=torch.cat([still, clip.rotations_local]),
        )

    return change


@pytest.fixture
def write_amc(tmp_path: Path) -> Callable[..., Path]:
    """Write trials of CMU's format on a body of two joints; returns the folder."""

    def write(names: Iterable[str], frames: int = 40, root: Path | None = None) -> Path:
        folder = root or tmp_path / "asf"
        for number, name in enumerate(names):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            subject = name.split("/")[0]
            asf = folder / subject / f"{subject}.asf"
            asf.write_text(ASF.format(length=5 + int(subject)))
            lines = [":FULLY-SPECIFIED", ":DEGREES"]
            for frame in range(frames):
                lines += [str(frame + 1), f"root 0 15 {frame} 0 {number} 0", f"lfemur {frame / 2}"]
            (folder / name).write_text("\n".join(lines) + "\n")
        return folder

    return write


@pytest.fixture
def write_amass(tmp_path: Path) -> Callable[..., Path]:
    """Write SMPL-H recordings, each another; returns the folder."""

    def write(rates: dict[str, float], frames: int = 60, root: Path | None = None) -> Path:
        folder = root or tmp_path / "amass"
        for number, (name, rate) in enumerate(rates.items()):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            generator = np.random.default_rng(number)
            np.savez(
                folder / name,
                poses=generator.normal(0, 0.02, (frames, 156)).cumsum(0),
                trans=generator.normal(0, 0.002, (frames, 3)).cumsum(0),
                mocap_framerate=np.array(rate),
            )
        return folder

    return write

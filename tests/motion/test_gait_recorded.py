"""Gait of recorded people: how often they step, which foot, and how still a planted one is."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
import torch
from torch import Tensor

from posecast.corpora import build_corpus
from posecast.motion import (
    Clip,
    Gait,
    analyse_gait,
    find_feet,
    leg_length,
    pin_feet,
    turn,
)
from posecast.motion.standing import Stand, find_stands
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

pytestmark = pytest.mark.data


class Walked(NamedTuple):
    """What one clip shows."""

    clip: Clip
    gait: Gait
    toes: Tensor

    @property
    def starts(self) -> Tensor:
        """(frame, foot) of each contact that begins, in order of time."""
        contacts = self.gait.contacts
        return (contacts[1:] & ~contacts[:-1]).nonzero() + torch.tensor([1, 0])

    @property
    def slides(self) -> list[float]:
        """Centimetres that the toes move on the floor in each contact that ends."""
        found: list[float] = []
        for frame, foot in self.starts.tolist():
            after = (~self.gait.contacts[frame:, foot]).nonzero().flatten()
            if len(after):
                toes = self.toes[frame : frame + int(after[0]), foot][:, [0, 2]]
                found.append(100 * float(toes.diff(dim=0).norm(dim=-1).sum()))
        return found


def walked(clip: Clip) -> Walked:
    feet = find_feet(clip.skeleton, clip.offsets)
    positions = joint_positions(
        clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions
    )
    return Walked(clip, analyse_gait(clip), positions[:, list(feet.toes)].double())


@pytest.fixture(scope="module")
def bandai(data_root: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Walked]:
    corpus = build_corpus(
        "bandai-locomotion",
        root=data_root / "bandai-locomotion",
        fps=30,
        cache=tmp_path_factory.mktemp("cache"),
    )
    assert len(corpus.clips) > 600
    return [walked(clip) for clip in corpus.clips]


@pytest.fixture(scope="module")
def asf(data_root: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Walked]:
    cache = tmp_path_factory.mktemp("cache")
    corpus = build_corpus("cmu-asf", root=data_root / "cmu-asf", fps=30, cache=cache)
    chosen = [clip for clip in corpus.clips if clip.labels["action"] in ("walk", "run")]
    assert len(chosen) == 12
    return [walked(clip) for clip in chosen]


@pytest.mark.parametrize(
    ("content", "slowest", "quickest"),
    [("walk", 1.4, 2.5), ("walk-turn-left", 1.4, 2.5), ("run", 2.1, 2.8)],
)
def test_people_step_as_often_as_people_do(
    bandai: list[Walked], content: str, slowest: float, quickest: float
) -> None:
    chosen = [walk for walk in bandai if walk.clip.labels["content"] == content]
    assert len(chosen) > 100
    for walk in chosen:
        assert walk.gait.walking.double().mean() > 0.9
        steps = float(walk.gait.step_rate[walk.gait.walking].median()) / math.pi
        assert slowest < steps < quickest


def test_left_and_right_take_turns(bandai: list[Walked], asf: list[Walked]) -> None:
    turns = [walk.starts[:, 1].diff() != 0 for walk in (*bandai, *asf)]
    assert torch.cat(turns).double().mean() > 0.995


def test_a_contact_begins_within_half_a_step_after_its_phase(bandai: list[Walked]) -> None:
    """Toes come down after the heel, in running after the flight."""
    late: dict[bool, list[Tensor]] = {True: [], False: []}
    for walk in bandai:
        frames, feet = walk.starts.unbind(-1)
        expected = torch.where(feet == 0, math.pi, 0.0)
        phase = walk.gait.phase[frames] - expected
        late[walk.clip.labels["content"] == "run"].append(
            torch.remainder(phase + math.pi, 2 * math.pi) - math.pi
        )
    for runs, lowest, highest in ((False, 0.2, 0.7), (True, 0.5, 1.2)):
        found = torch.cat(late[runs])
        assert found.quantile(0.05) > lowest
        assert found.quantile(0.95) < highest


def test_planted_feet_slide_little(bandai: list[Walked], asf: list[Walked]) -> None:
    for walks in (bandai, asf):
        slides = torch.tensor([slide for walk in walks for slide in walk.slides])
        assert len(slides) > 40
        assert slides.mean() < 2.5
        assert slides.quantile(0.95) < 4.5


def test_stands_that_may_slide_are_the_contacts_of_feet_that_do_not(bandai: list[Walked]) -> None:
    """Precision and recall of the frames against contacts by speed, and of whole contacts."""
    both = found = true = whole = hit = 0
    for walk in bandai:
        stands = _stands(walk)
        frames = torch.zeros_like(walk.gait.contacts)
        for stand in stands:
            hit += bool(walk.gait.contacts[stand.frames, stand.foot].any())
            frames[stand.frames, stand.foot] = True
        both += int((frames & walk.gait.contacts).sum())
        found += int(frames.sum())
        true += int(walk.gait.contacts.sum())
        whole += len(stands)
    assert both / found > 0.985
    assert both / true > 0.93
    assert whole > 5000
    assert hit / whole > 0.999


def _stands(walk: Walked) -> list[Stand]:
    feet = find_feet(walk.clip.skeleton, walk.clip.offsets)
    leg = leg_length(walk.clip.skeleton, walk.clip.offsets, feet)
    return find_stands(walk.toes, fps=walk.clip.fps, leg=leg)


def test_recorded_feet_are_pinned_with_little_change_and_once(
    bandai: list[Walked], data_root: Path, tmp_path: Path
) -> None:
    """All that is in `cmu-asf` too, playgrounds and jumps among it."""
    corpus = build_corpus("cmu-asf", root=data_root / "cmu-asf", fps=30, cache=tmp_path)
    for clip in (*(walk.clip for walk in bandai[::10]), *corpus.clips):
        pinned, report = pin_feet(clip)
        assert report.largest_cm < (2.5 if "content" in clip.labels else 10)
        assert report.largest_deg < (12 if "content" in clip.labels else 30)
        again, report = pin_feet(pinned)
        assert report.moved == 0
        assert torch.equal(again.rotations_local, pinned.rotations_local)


def test_the_root_stays_near_its_path(bandai: list[Walked]) -> None:
    for walk in bandai:
        assert walk.gait.lateral.abs().max() < 0.10
        assert walk.gait.longitudinal.abs().max() < 0.12


def test_without_the_names_of_joints_the_feet_are_the_same(
    bandai: list[Walked], asf: list[Walked]
) -> None:
    """By geometry, in the clip's own poses: the rest pose of the first bodies does not stand."""
    for walk in (*bandai[::90], *asf[::4]):
        away = turn(walk.clip, 2.0)
        names = tuple(f"joint {joint}" for joint in range(len(away.skeleton)))
        unnamed = replace(away, skeleton=Skeleton(names, away.skeleton.parents))
        found = analyse_gait(unnamed)
        assert torch.equal(found.contacts, walk.gait.contacts)
        assert (found.phase - walk.gait.phase).abs().max() < 1e-4

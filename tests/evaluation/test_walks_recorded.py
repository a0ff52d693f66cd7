"""Contacts by height of recorded people who walk: one a step, half a cycle long, hardly sliding."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from posecast.corpora import build_corpus
from posecast.evaluation.footing import floor_contacts, sliding
from posecast.evaluation.walked import Walked
from posecast.evaluation.walks import reference_of, score_walk
from posecast.motion import Corpus

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def corpus(data_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    return build_corpus(
        "bandai-locomotion",
        root=data_root / "bandai-locomotion",
        fps=30,
        cache=tmp_path_factory.mktemp("cache"),
    )


@pytest.fixture(scope="module")
def walks(corpus: Corpus) -> list[Walked]:
    """The validation clips on which ``NEAR`` was chosen."""
    clips = [clip for clip in corpus.split("validation") if clip.labels["content"] != "run"]
    assert len(clips) == 47
    return [Walked.of(clip) for clip in clips]


def contacts_of(walk: Walked) -> torch.Tensor:
    return floor_contacts(walk.toes, fps=walk.clip.fps, leg=walk.leg)


def test_a_contact_lasts_half_a_cycle_and_there_is_one_in_each(walks: list[Walked]) -> None:
    lasting, often = [], []
    for walk in walks:
        cycle = 2 * math.pi / float(walk.gait.step_rate[walk.gait.walking].median()) * walk.clip.fps
        contacts = contacts_of(walk).int()
        begins = (contacts.diff(dim=0) == 1).sum(0)
        often.append(begins.double() / (walk.clip.frames / cycle))
        lasting.append(contacts.double().mean(0))
        for foot in (0, 1):
            edges = contacts[:, foot].diff().nonzero()[:, 0]
            inner = edges[int(contacts[0, foot]) :]
            lengths = inner[1::2] - inner[: len(inner[1::2]) * 2 : 2]
            lasting.append(lengths.double() / cycle)
    assert torch.cat(often).mean() == pytest.approx(1.0, abs=0.1)
    assert 0.48 < float(torch.cat(lasting).median()) < 0.6


def test_planted_feet_slide_little_by_height_as_well(walks: list[Walked]) -> None:
    found = [
        sliding(walk.toes, contacts_of(walk), fps=walk.clip.fps, leg=walk.leg) for walk in walks
    ]
    mean = torch.tensor([each[1:] for each in found]).double().mean(0).tolist()
    assert mean[0] < 3.5
    assert mean[1] < 3.0
    assert mean[2] < 0.25


def test_real_clips_do_not_sink_and_are_like_one_another(corpus: Corpus) -> None:
    def normal(split: str):
        labels = {"content": "walk", "style": "normal"}
        return [clip for clip in corpus.split(split) if labels.items() <= clip.labels.items()]

    reference = reference_of(normal("train"))
    for clip in normal("validation"):
        scores = score_walk(clip, reference=reference)
        assert scores.sink_max < 0.5
        assert scores.spectrum < 0.2
        assert 0.8 < scores.power < 1.25
        assert scores.lean < 8

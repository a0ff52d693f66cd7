"""Laws of the feeds: the share of truth follows the schedule; same generator, same mask."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.training.feeding import (
    FEEDS,
    AutoConditioning,
    FreeRunning,
    ScheduledSampling,
    TeacherForcing,
)

EPOCHS = (0, 1, 40, 300)


def test_there_are_four_feeds():
    assert set(FEEDS) == {
        *("teacher_forcing", "free_running", "scheduled_sampling", "auto_conditioning"),
    }


@pytest.mark.parametrize("epoch", EPOCHS)
@pytest.mark.parametrize("kind", FEEDS)
def test_the_share_of_truth_follows_the_schedule(kind, epoch, generator):
    feed = FEEDS[kind]()
    masks = torch.stack([feed.mask(11, epoch, generator) for _ in range(2000)])
    share = masks[:, 1:].double().mean().item()
    # 20 000 draws: four standard deviations are at most 0.0142.
    assert share == pytest.approx(feed.share(epoch), abs=0.015)


@pytest.mark.parametrize("epoch", EPOCHS)
@pytest.mark.parametrize("kind", FEEDS)
def test_the_same_generator_gives_the_same_mask(kind, epoch):
    feed = FEEDS[kind]()
    first, second = (feed.mask(50, epoch, torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(first, second)
    assert first.shape == (50,)


@pytest.mark.parametrize("kind", FEEDS)
def test_the_first_step_always_follows_a_true_frame(kind, generator):
    feed = FEEDS[kind]()
    assert all(feed.mask(3, 5000, generator)[0] for _ in range(20))


def test_steps_are_drawn_one_by_one(generator):
    mask = ScheduledSampling(0.5).mask(200, 1, generator)
    assert 60 < mask.sum() < 140


def test_scheduled_sampling_begins_as_teacher_forcing_and_ends_as_free_running(generator):
    feed = ScheduledSampling(0.995)
    forced, free = TeacherForcing(), FreeRunning()
    assert torch.equal(feed.mask(500, 0, generator), forced.mask(500, 0, generator))
    assert torch.equal(feed.mask(500, 10_000, generator), free.mask(500, 10_000, generator))
    # Pavllo et al. 2018: 0.995 ** 920 = 0.0099
    assert feed.share(900) > 0.01 > feed.share(930)


def test_auto_conditioning_repeats_its_pattern_true_frames_first(generator):
    # Zhou et al. 2018: of 100 inputs five are true, five its own, and so on.
    assert AutoConditioning().mask(100, 7, generator).tolist() == 10 * (5 * [True] + 5 * [False])
    assert AutoConditioning(2, 1).mask(7, 0, generator).tolist() == [
        *(True, True, False),
        *(True, True, False),
        True,
    ]
    assert AutoConditioning(3, 0).mask(9, 0, generator).all()
    assert AutoConditioning(2, 6).share(3) == 0.25


@pytest.mark.parametrize(("true", "own"), [(1, 1), (1, 4), (4, 1), (5, 5), (7, 0)])
def test_auto_conditioning_takes_turns_of_any_length_and_draws_nothing(true, own, generator):
    feed = AutoConditioning(true, own)
    before = generator.get_state()
    turn = [True] * true + [False] * own
    for horizon in (0, 1, true, true + 1, 23):
        found = feed.mask(horizon, 3, generator)
        assert found.dtype == torch.bool
        assert found.tolist() == (23 * turn)[:horizon]
    assert torch.equal(generator.get_state(), before)
    assert feed.share(0) == feed.share(9) == sum(turn) / len(turn)


def test_its_own_run_may_grow_as_training_goes_on(generator):
    feed = AutoConditioning(2, 1, grow_every=3)
    assert [feed.own(epoch) for epoch in (0, 2, 3, 5, 6, 30)] == [1, 1, 2, 2, 3, 11]
    turn = [True, True, False, False, False]
    assert feed.mask(12, 7, generator).tolist() == (3 * turn)[:12]
    assert feed.share(7) == 2 / 5
    with pytest.raises(ConfigError, match="grows every 0 epochs: expected 1 or more"):
        AutoConditioning(2, 1, grow_every=0)


@pytest.mark.parametrize(("true", "own"), [(0, 5), (5, -1)])
def test_a_pattern_without_true_frames_is_refused(true, own):
    with pytest.raises(ConfigError, match=f"with {true} true and {own} own frames"):
        AutoConditioning(true, own)


@pytest.mark.parametrize("decay", [-0.1, 1.1])
def test_a_decay_that_is_no_probability_is_refused(decay):
    with pytest.raises(ConfigError, match="expected 0 to 1"):
        ScheduledSampling(decay)

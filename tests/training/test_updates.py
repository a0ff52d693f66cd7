"""The updates of a run are those of QuaterNet's loop, written out by hand with PyTorch alone."""

from __future__ import annotations

import torch

from posecast.training import Objective
from posecast.training.feeding import ScheduledSampling
from posecast.training.sampling import Windows
from posecast.training.schedules import derived_generator
from posecast.training.step import training_loss

EPOCHS, BATCH, CLIP, DECAY = 3, 3, 0.1, 0.5


def test_each_update_clips_the_gradient_and_takes_the_rate_of_its_epoch(tiny, tmp_path):
    trained = tiny.tiny_forecaster()
    result = tiny.train(tmp_path, epochs=EPOCHS, forecaster=trained, clip=CLIP, decay=DECAY)
    by_hand = tiny.tiny_forecaster()
    length = tiny.PREFIX + tiny.HORIZON
    windows = Windows(tiny.tiny_corpus(), length=length, batch=BATCH, seed=0, turn=True)
    optimizer = torch.optim.Adam(by_hand.parameters())
    clipped = 0
    for epoch in range(EPOCHS):
        for step in range(windows.steps):
            optimizer.param_groups[0]["lr"] = 0.001 * DECAY**epoch
            draws = derived_generator(0, "feed", epoch, step)
            loss = training_loss(
                by_hand,
                windows.share(epoch, step).motion,
                prefix=tiny.PREFIX,
                mask=ScheduledSampling(0.98).mask(tiny.HORIZON, epoch, draws),
                objective=Objective({"euler": 1.0, "penalty": 0.01}),
            )
            optimizer.zero_grad()
            loss.total.backward()
            gradients = [weight.grad for weight in by_hand.parameters()]
            norm = torch.stack([gradient.square().sum() for gradient in gradients]).sum().sqrt()
            clipped += bool(norm > CLIP)
            for gradient in gradients:
                gradient.mul_(min(1.0, CLIP / float(norm)))
            optimizer.step()
    assert clipped == result.updates == EPOCHS * windows.steps > EPOCHS
    for (name, found), expected in zip(
        trained.named_parameters(), by_hand.parameters(), strict=True
    ):
        # A step is 1e-3 at first; sums in another order differ by float32's last places.
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=2e-6, msg=name)

"""Adversarial training: discriminators learn to tell predictions from the truth, side by side.

The forecaster descends its objective and how well the discriminators see through it; they descend
how badly they do. Both take their gradients from one and the same rollout, with the weights that
the other had before this update, so neither goes first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import softplus
from torch.optim import Optimizer

from posecast.errors import ConfigError
from posecast.model.discriminator import Discriminator
from posecast.model.forecaster import Forecaster
from posecast.training.objective import Loss
from posecast.training.optimizers import OPTIMIZERS
from posecast.training.plan import Plan
from posecast.training.schedules import derived_generator
from posecast.training.state import TrainingState, optimizer_moments, restore_moments
from posecast.training.step import Attempt


@dataclass(frozen=True)
class Adversary:
    """Which discriminators judge the forecaster in training, and how they learn.

    Args:
        fidelity: weight, beside the objective, of the one that reads predictions alone; ``None``:
            there is none.
        continuity: weight of the one that reads the frames given and the prediction after them.
        hidden: units of each: see ``Discriminator``.
        learning_rate: of their first update; ``None``: the forecaster's. It decays when, and by
            what, the forecaster's does.

    Raises:
        ConfigError: no discriminator, a weight or rate that is not positive, or no units.

    Source: Gui et al. 2018. Their objective is the geodesic loss plus both adversarial losses,
    which share one weight.
    """

    fidelity: float | None = None
    continuity: float | None = None
    hidden: int = 1024
    learning_rate: float | None = None

    def __post_init__(self) -> None:
        if not self.weights:
            raise ConfigError("an adversary needs a weight for fidelity, for continuity, or both")
        for name, weight in self.weights.items():
            if not 0 < weight < math.inf:
                raise ConfigError(
                    f"{name} has weight {weight}; expected more than 0, or null to leave it out"
                )
        if self.hidden < 1:
            raise ConfigError(f"hidden is {self.hidden}; expected 1 or more")
        if self.learning_rate is not None and not 0 < self.learning_rate < math.inf:
            raise ConfigError(f"learning_rate is {self.learning_rate}; expected more than 0")

    @property
    def weights(self) -> dict[str, float]:
        """Weight of each discriminator that there is, by name."""
        named = {"fidelity": self.fidelity, "continuity": self.continuity}
        return {name: weight for name, weight in named.items() if weight is not None}


class Pair(NamedTuple):
    """What a discriminator is to tell apart; the same number of motions, in the same order.

    Args:
        real: true frames.
        predicted: the same with the forecaster's in the place of those of the horizon.
    """

    real: Float[Tensor, "batch frames features"]
    predicted: Float[Tensor, "batch frames features"]


def forecaster_loss(logits: Float[Tensor, " batch"]) -> Float[Tensor, ""]:
    """What predictions cost the forecaster that look like this: mean of -log D.

    With it the forecaster's gradient is the greater, the surer a discriminator sees through it.
    The minimax game as it is written, log(1 - D), has the same equilibrium and next to no gradient
    there; which of the two Gui et al. descended is not known (Goodfellow et al. 2014 name both).

    Args:
        logits: of what the forecaster predicted.
    """
    return softplus(-logits).mean()


def discriminator_loss(
    real: Float[Tensor, " batch"], predicted: Float[Tensor, " batch"]
) -> Float[Tensor, ""]:
    """Cross-entropy of a discriminator: mean of -log D(real) - log(1 - D(predicted)).

    2 log 2 where it cannot tell them apart (Goodfellow et al. 2014).
    """
    return softplus(-real).mean() + softplus(predicted).mean()


def accuracy(
    real: Float[Tensor, " batch"], predicted: Float[Tensor, " batch"]
) -> Float[Tensor, ""]:
    """Share that a discriminator takes for what it is, true and predicted ones counted alike."""
    right = (real > 0).to(real), (predicted <= 0).to(real)
    return torch.stack(right).mean()


class Discriminators:
    """The discriminators of a run, and their optimizer.

    They read features as the forecaster does: valid, standardized where it standardizes, root
    channels included. Valid, not as emitted: that a raw quaternion is no unit would give it away,
    and is what the representation's penalty is for. Numbers of actions are left out for the same
    reason: a prediction never has exactly 1 among zeros, and they are no motion.

    Between their own updates their weights take no gradients, so the forecaster's loss, which
    goes through them, leaves none behind. They are no part of the forecaster or its checkpoints.

    Args:
        adversary: which there are.
        forecaster: what they read features like; it is not changed.
        plan: seed, optimizer, schedule of the learning rate and largest norm of their gradients.
        begin: the state of a run that goes on.
    """

    def __init__(
        self,
        adversary: Adversary,
        forecaster: Forecaster,
        plan: Plan,
        begin: TrainingState | None = None,
    ) -> None:
        self.adversary, self.forecaster, self.plan = adversary, forecaster, plan
        rate = adversary.learning_rate
        self.rate = plan.rate if rate is None else replace(plan.rate, start=rate)
        self.networks = nn.ModuleDict()
        codec = forecaster.codec
        for name in adversary.weights:
            with torch.random.fork_rng(devices=[]):  # what is drawn here is drawn anew at once
                network = Discriminator(codec.joint_features + codec.root_dim, adversary.hidden)
            network.reset_parameters(derived_generator(plan.seed, "discriminator", name))
            self.networks[name] = network
        self.networks.to(next(forecaster.parameters()).dtype).requires_grad_(False)
        self._moments: Mapping[str, Tensor] = {}
        if begin is not None:
            self.networks.load_state_dict(dict(begin.discriminators))
            self._moments = begin.discriminator_moments
        self.optimizer: Optimizer | None = None

    def start(self, device: torch.device) -> None:
        """Move to where the forecaster is, and take up the moments there were."""
        self.networks.to(device)
        rate = self.rate.at(epoch=0, update=0)  # set anew before every update
        self.optimizer = OPTIMIZERS[self.plan.optimizer](self.networks.parameters(), rate)
        restore_moments(self.optimizer, self.networks, self._moments)

    def moments(self) -> dict[str, Tensor]:
        """The optimizer's tensors, named ``<discriminator>.<parameter>/<entry>``."""
        if self.optimizer is None:
            return dict(self._moments)
        return optimizer_moments(self.optimizer, self.networks)

    def pairs(self, attempt: Attempt) -> dict[str, Pair]:
        """What each discriminator reads of an attempt, by name; gradients reach the prediction."""
        given = self._read(attempt.given)
        found = Pair(
            self._read(attempt.comparison.target), self._read(attempt.comparison.predicted)
        )
        whole = Pair(*(torch.cat([given, frames], dim=1) for frames in found))
        views = {"fidelity": found, "continuity": whole}
        return {name: views[name] for name in self.networks}

    def _read(self, features: Tensor) -> Tensor:
        """The part of features that is motion, standardized."""
        split = self.forecaster.codec.split(self.forecaster.standardize(features))
        return self.forecaster.codec.merge(split.joints, split.root)

    def oppose(self, loss: Loss, pairs: Mapping[str, Pair]) -> Loss:
        """The forecaster's loss with what the discriminators make of its predictions.

        Args:
            loss: the objective.
            pairs: from ``pairs``.
        """
        terms = {
            name: forecaster_loss(self.networks[name](pair.predicted))
            for name, pair in pairs.items()
        }
        weighted = [weight * terms[name] for name, weight in self.adversary.weights.items()]
        return Loss(loss.total + torch.stack(weighted).sum(), {**loss.terms, **terms})

    def learn(
        self,
        pairs: Mapping[str, Pair],
        *,
        weight: float,
        epoch: int,
        update: int,
        average: Callable[[Tensor], Tensor],
    ) -> dict[str, Tensor]:
        """One update of all discriminators; nothing reaches the forecaster.

        Args:
            pairs: from ``pairs``; predictions are taken as they are, without their graph.
            weight: of this process's share, see ``Batch``.
            epoch: of the run, from 0.
            update: of the run, from 0.
            average: the mean of a tensor over all processes.

        Returns:
            ``<name>/loss`` and ``<name>/accuracy`` of this share, before the update and unweighted.
        """
        assert self.optimizer is not None, "not started"
        with self._learning():
            found, losses = {}, []
            for name, pair in pairs.items():
                both = torch.cat([pair.real, pair.predicted]).detach()
                real, predicted = self.networks[name](both).chunk(2)
                losses.append(discriminator_loss(real, predicted))
                found[f"{name}/loss"] = losses[-1].detach()
                found[f"{name}/accuracy"] = accuracy(real.detach(), predicted.detach())
            (torch.stack(losses).sum() * weight).backward()
            self._average_gradients(average)
            limit = math.inf if self.plan.clip is None else self.plan.clip
            nn.utils.clip_grad_norm_(self.networks.parameters(), limit)
            for group in self.optimizer.param_groups:
                group["lr"] = self.rate.at(epoch=epoch, update=update)
            self.optimizer.step()
        return found

    @contextmanager
    def _learning(self) -> Iterator[None]:
        """In here the discriminators' weights take gradients."""
        self.networks.requires_grad_(True)
        try:
            yield
        finally:
            self.networks.requires_grad_(False)
            self.networks.zero_grad()

    def _average_gradients(self, average: Callable[[Tensor], Tensor]) -> None:
        """Average over processes, all gradients in one piece."""
        gradients = [weight.grad for weight in self.networks.parameters()]
        pieces = [gradient for gradient in gradients if gradient is not None]
        assert len(pieces) == len(gradients)
        means = average(torch.cat([piece.flatten() for piece in pieces]))
        for piece, mean in zip(pieces, means.split([p.numel() for p in pieces]), strict=True):
            piece.copy_(mean.view_as(piece))

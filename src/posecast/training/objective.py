"""Objectives: which losses are descended, each with its weight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.geometry.euler import ORDERS
from posecast.representation import REPRESENTATIONS, build_representation
from posecast.representation.codec import Codec
from posecast.training.comparison import Comparison
from posecast.training.losses import LOSSES

_WORDS = {
    "rotations": "rotations",
    "translations": "translations from parent to joint",
    "constraint": "numbers that may be invalid",
}


class Loss(NamedTuple):
    """The value to descend, and its terms before weighting, by name."""

    total: Float[Tensor, ""]
    terms: dict[str, Tensor]


@dataclass(frozen=True)
class Objective:
    """A weighted sum of terms.

    Args:
        terms: weight of each term of ``LOSSES``; QuaterNet's are the default.
        order: Euler order of the terms that measure angles.

    Raises:
        ConfigError: no term, an unknown one, a weight that is not positive, or another order than
            the default without a term that measures angles.
    """

    terms: Mapping[str, float]
    order: str = "zyx"

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError(f"an objective needs a term; known: {', '.join(LOSSES)}")
        for name, weight in self.terms.items():
            if name not in LOSSES:
                raise ConfigError(f"unknown loss {name!r}; {did_you_mean(name, LOSSES)}")
            if not weight > 0:
                raise ConfigError(f"loss {name!r} has weight {weight}; expected more than 0")
        if self.order not in ORDERS:
            raise ConfigError(
                f"order {self.order!r} is unknown; {did_you_mean(self.order, ORDERS)}"
            )
        if self.order != Objective.order and "euler" not in self.terms:
            raise ConfigError(
                f"order {self.order!r} changes nothing without the loss 'euler'; leave it out"
            )

    def check(self, codec: Codec) -> None:
        """Refuse a codec that these terms do not fit, before any training.

        Raises:
            ConfigError: a term of what the representation does not state, root channels or actions
                without a loss, or a loss without them.
        """
        for name in self.terms:
            _check_term(name, codec)
        channels = codec.root_dim
        along = {"displacement"} if codec.follows_path else set()
        if channels and not {"root", "features", *along} & set(self.terms):
            raise ConfigError(
                f"the codec writes {channels} root channels that no loss trains; "
                f"add root: 1.0 (or {', '.join(['features', *along])}) to the loss, or write no "
                "root channels"
            )
        if "displacement" in self.terms and not codec.follows_path:
            raise ConfigError(
                "loss 'displacement' needs a root that follows a path; set codec.root to path or "
                "path_lateral, or leave the loss out"
            )
        if "displacement" in self.terms and not {"position", "root", "features"} & set(self.terms):
            raise ConfigError(
                "loss 'displacement' leaves the height of the root untrained; add position: 1.0"
            )
        told = len(codec.actions)
        if told and not {"action", "features"} & set(self.terms):
            raise ConfigError(
                "codec.actions lists actions that no loss trains; add action: 1.0 (or features) to "
                "the loss, or leave them out"
            )
        if not told and "action" in self.terms:
            raise ConfigError(
                "loss 'action' needs actions, but the codec has none; list them in codec.actions, "
                "or leave the loss out"
            )
        if not channels and "root" in self.terms:
            raise ConfigError(
                "loss 'root' needs root channels, but the codec writes none; "
                "set its root to displacement, or leave the loss out"
            )

    def __call__(self, comparison: Comparison) -> Loss:
        """All terms and their weighted sum."""
        terms = {name: LOSSES[name](comparison) for name in self.terms}
        weighted = [weight * terms[name] for name, weight in self.terms.items()]
        return Loss(torch.stack(weighted).sum(), terms)


def _check_term(name: str, codec: Codec) -> None:
    """Refuse a loss of what features do not state; names the representations that do."""
    needs = LOSSES[name].needs
    if needs <= codec.representation.states:
        return
    made = {kind: build_representation(kind, codec.written) for kind in REPRESENTATIONS}
    own = next(
        (kind for kind, each in made.items() if each == codec.representation),
        type(codec.representation).__name__,
    )
    fitting = ", ".join(kind for kind, each in made.items() if needs <= each.states)
    missing = " and ".join(_WORDS[content] for content in sorted(needs))
    raise ConfigError(
        f"loss {name!r} needs {missing}, which representation {own!r} does not have; leave it "
        f"out, or choose a representation among: {fitting}"
    )

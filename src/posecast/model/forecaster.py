"""The forecaster: from the features of frames to the features of the frame after each."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.body_parts import BodyParts
from posecast.model.controls import ControlLayers
from posecast.model.head import Head, layer_sizes, linear_layers, reset_linear, start_linear_at
from posecast.model.recurrent import Backbone, State
from posecast.representation import Codec

Residual = Literal["none", "add", "compose"]
Feedback = Literal["valid", "emitted"]


class Prediction(NamedTuple):
    """What a forecaster says after each of the frames it read.

    Args:
        features: the frame that follows, valid features.
        raw: what the representation's penalty is taken of: the joints of that frame before they
            were projected, or, where the residual is ``compose``, the change that was applied.
        emitted: the features before they were projected, whatever the residual.
        state: what the backbone needs in order to read on.
    """

    features: Float[Tensor, "batch frames features"]
    raw: Float[Tensor, "batch frames joints joint_dim"]
    emitted: Float[Tensor, "batch frames features"]
    state: State


class Forecaster(nn.Module):
    """Predicts the next frame: input layers, backbone, head, residual, projection.

    Root channels come from a linear layer of their own, beside any head, and so do actions.

    Args:
        codec: what the features mean; its statistics, if any, standardize what the network reads
            and are undone in what it puts out.
        backbone: makes the backbone for a number of inputs; one with a parameter ``skeleton`` gets
            the joints and ``joint_dim``, too: its inputs are those of the joints, one after the
            other, then all others.
        head: makes the head for a context size, a skeleton and a number of values a joint; one with
            a parameter ``body`` gets the parts that the backbone speaks of.
        residual: ``none``: the network puts out the next pose; ``add``: what to add to the pose it
            read; ``compose``: what to apply to it by the representation's own product (Pavllo et
            al. 2018, section 3.1). Root channels and actions add in both of the latter.
        input_dropout: share of the inputs set to zero in training; the residual reads them all.
        input_noise: standard deviation of the Gaussian noise added in training to what the backbone
            reads, in units of the standardized inputs, or of the features where nothing is
            standardized; the residual reads them as they are. From poses that no recording has the
            network so learns to come back (Fragkiadaki et al. 2015, whose standard deviation grows
            in training: see ``Plan.noise_at``).
        input_noise_share: share of the frames, drawn for each sequence, that get noise.
        feedback: what is read of a prediction in a rollout: ``valid`` features, or what was
            ``emitted`` before they were projected, so that matrices, say, drift from rotations as
            with the code of Aksan et al. 2019.
        projection: sizes of linear layers before the backbone, or of the only one, rectified
            units but for the last; ``None``: no such layer.
        projection_activation: what follows the last of them: nothing, or rectification.
        still_start: begin training near zero velocity: the output layers start at the residual's
            identity with small weights, so the first predictions repeat the last frame. No paper
            here does so; a network of any size saves the epochs in which it learns to stand still.
        controls: layers that prepare the controls of a frame for the backbone; ``None``: the
            forecaster takes no controls.

    Raises:
        ConfigError: an unknown choice, a number out of its range, or parts that do not go together.
    """

    def __init__(
        self,
        codec: Codec,
        *,
        backbone: Callable[..., Backbone],
        head: Callable[..., Head],
        residual: Residual = "none",
        input_dropout: float = 0.0,
        input_noise: float = 0.0,
        input_noise_share: float = 1.0,
        feedback: Feedback = "valid",
        projection: int | list[int] | None = None,
        projection_activation: Literal["none", "relu"] = "none",
        still_start: bool = False,
        controls: ControlLayers | None = None,
    ) -> None:
        super().__init__()
        if residual not in get_args(Residual):
            raise ConfigError(
                f"residual: {residual!r} is not known; choose among: "
                f"{', '.join(get_args(Residual))}"
            )
        if not 0 <= input_dropout < 1:
            raise ConfigError(f"input_dropout: {input_dropout} is no share; expected 0 <= it < 1")
        if not 0 <= input_noise < math.inf:
            raise ConfigError(
                f"input_noise: {input_noise} is no standard deviation; expected 0 or more"
            )
        if not 0 < input_noise_share <= 1:
            raise ConfigError(
                f"input_noise_share: {input_noise_share} is no share; expected 0 < it <= 1"
            )
        if feedback not in ("valid", "emitted"):
            raise ConfigError(f"feedback: {feedback!r} is not known; choose 'valid' or 'emitted'")
        if projection_activation not in ("none", "relu"):
            raise ConfigError(
                f"projection_activation: {projection_activation!r} is not known; "
                "choose 'none' or 'relu'"
            )
        if not projection and projection_activation != "none":
            raise ConfigError(
                f"projection_activation: {projection_activation!r} follows a projection, but there "
                "is none; set projection to its size, or leave the activation out"
            )
        self.codec = codec
        self.residual: Residual = residual
        self.input_dropout = input_dropout
        self.input_noise = input_noise
        self.input_noise_share = input_noise_share
        self.feedback: Feedback = feedback
        self.rectify_projection = projection_activation == "relu"
        sizes = layer_sizes(codec.feature_dim, projection, "projection")
        self.projection = linear_layers(sizes)
        self.controls = controls
        inputs = sizes[-1] + (0 if controls is None else controls.output_dim)
        joints = _joints_for(backbone, codec, projected=len(sizes) > 1)
        self.backbone = backbone(inputs, **joints)
        context_dim = self.backbone.context_dim
        parts = _parts_for(head, getattr(self.backbone, "body", None))
        self.head = head(context_dim, codec.written, codec.representation.joint_dim, **parts)
        self.root = nn.Linear(context_dim, codec.root_dim) if codec.root_dim else None
        self.action = nn.Linear(context_dim, len(codec.actions)) if codec.actions else None
        statistics = codec.statistics
        for name in ("mean", "scale"):
            values = None if statistics is None else getattr(statistics, name)
            values = None if values is None else values.to(torch.get_default_dtype())
            self.register_buffer(name, values, persistent=False)
        if still_start and residual == "none":
            raise ConfigError(
                "still_start: without a residual there is no last frame to repeat; "
                "set residual to add or compose, or leave still_start out"
            )
        self.still_start = still_start
        self._begin_still()

    mean: Tensor | None
    scale: Tensor | None

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, from ``generator`` (``None``: PyTorch's own)."""
        for linear in (*self.projection, self.root, self.action):
            if linear is not None:
                reset_linear(linear, generator)
        if self.controls is not None:
            self.controls.reset_parameters(generator)
        self.backbone.reset_parameters(generator)
        self.head.reset_parameters(generator)
        self._begin_still()

    def _begin_still(self) -> None:
        """Let the output layers start at the residual's identity, if that was asked for."""
        if not self.still_start:
            return
        representation, joints = self.codec.representation, len(self.codec.written)
        nothing = torch.zeros(joints, representation.joint_dim)
        self.head.start_at(
            representation.identity(nothing) if self.residual == "compose" else nothing
        )
        for linear in (self.root, self.action):
            if linear is not None:
                start_linear_at(linear, torch.zeros(linear.out_features))

    def initial_state(self, batch: int) -> State:
        """The state before anything was read."""
        return self.backbone.initial_state(batch)

    def standardize(
        self, features: Float[Tensor, "*batch features"]
    ) -> Float[Tensor, "*batch features"]:
        """Features as the network reads them: ``(features - mean) / scale``."""
        if self.mean is None or self.scale is None:
            return features
        return (features - self.mean) / self.scale

    def forward(
        self,
        features: Float[Tensor, "batch frames features"],
        state: State,
        controls: Float[Tensor, "batch frames controls"] | None = None,
        *,
        last: int | None = None,
        generator: torch.Generator | None = None,
    ) -> Prediction:
        """Read frames and predict the frame after each.

        Args:
            features: true or predicted frames, the oldest first.
            state: from ``initial_state``, or from the prediction before.
            controls: of the same frames, for a forecaster that takes them.
            last: predict only after that many of the frames, the newest; ``None``: after all.
            generator: what input dropout and noise draw from in training; ``None``: PyTorch's own.

        Raises:
            ConfigError: controls are missing, or given to a forecaster that takes none.
        """
        inputs = self._inputs(features, controls, generator)
        context, state = self.backbone(inputs, state)
        first = 0 if last is None else features.shape[1] - last
        predicted, raw, emitted = self._next(features[:, first:], context[:, first:])
        return Prediction(predicted, raw, emitted, state)

    def _inputs(
        self, features: Tensor, controls: Tensor | None, generator: torch.Generator | None
    ) -> Tensor:
        """What the backbone reads."""
        inputs = self.standardize(features)
        if self.training and self.input_noise > 0:
            noise = self.input_noise * _draw(torch.randn, inputs, generator)
            if self.input_noise_share < 1:
                chosen = _draw(torch.rand, inputs[..., :1], generator) < self.input_noise_share
                noise = noise * chosen
            inputs = inputs + noise
        if self.training and self.input_dropout > 0:
            drawn = _draw(torch.rand, inputs, generator)
            inputs = inputs * (drawn >= self.input_dropout) / (1 - self.input_dropout)
        for number, layer in enumerate(self.projection, start=1):
            inputs = layer(inputs)
            if self.rectify_projection or number < len(self.projection):
                inputs = inputs.relu()
        if self.controls is None:
            if controls is not None:
                raise ConfigError("controls were given, but this forecaster takes none")
            return inputs
        if controls is None:
            raise ConfigError(f"this forecaster takes {self.controls.input_dim} controls a frame")
        return torch.cat([inputs, self.controls(controls)], dim=-1)

    def _next(self, features: Tensor, context: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Valid features of the next frame, the raw output for its joints, and all that it gives
        before it is projected."""
        codec = self.codec
        joints = self.head(context)
        root = features[..., :0] if self.root is None else self.root(context)
        if self.scale is not None and self.mean is not None:
            scale, mean = codec.split(self.scale), codec.split(self.mean)
            root = root * scale.root + (mean.root if self.residual == "none" else 0)
            if self.residual != "compose":
                joints = joints * scale.joints + (mean.joints if self.residual == "none" else 0)
        base = codec.split(features)
        if self.residual != "none":
            root = base.root + root
        if self.residual == "add":
            joints = base.joints + joints
        raw = joints
        if self.residual == "compose":
            joints = codec.representation.compose(raw, base.joints)
        action = None
        if self.action is not None:
            action = self.action(context)
            action = action if self.residual == "none" else base.action + action
        valid = codec.merge(codec.representation.project(joints), root, action)
        return valid, raw, codec.merge(joints, root, action)


def _joints_for(
    backbone: Callable[..., Backbone], codec: Codec, *, projected: bool
) -> dict[str, object]:
    """What a backbone that asks for the joints is told of them; for others nothing."""
    if "skeleton" not in inspect.signature(backbone).parameters:
        return {}
    if projected:
        raise ConfigError(
            "projection: the backbone reads joints, which a projection mixes; leave projection "
            "out, or choose another backbone"
        )
    return {"skeleton": codec.written, "joint_dim": codec.representation.joint_dim}


def _parts_for(head: Callable[..., Head], body: BodyParts | None) -> dict[str, object]:
    """What a head that asks for the parts of the body is told of them; for others nothing."""
    if "body" not in inspect.signature(head).parameters:
        return {}
    if body is None:
        raise ConfigError(
            "head: it reads what is said of each part of the body, but the backbone knows no "
            "parts; choose backbone structural_rnn, or another head"
        )
    return {"body": body}


def _draw(how: Callable[..., Tensor], like: Tensor, generator: torch.Generator | None) -> Tensor:
    """Random numbers in the shape and precision of ``like``, on its device."""
    return how(like.shape, generator=generator, dtype=like.dtype, device=like.device)

"""Backbones, heads, the forecaster, its rollout, and baselines without a network."""

from __future__ import annotations

from collections.abc import Callable

from posecast.model.baselines import MeanPose, RunningAverage, ZeroVelocity
from posecast.model.body_parts import BodyParts
from posecast.model.controls import ControlLayers
from posecast.model.convolutional import ConvolutionalBackbone
from posecast.model.discriminator import Discriminator
from posecast.model.early_reset import EarlyResetGRUBackbone
from posecast.model.forecaster import Forecaster, Prediction, Residual
from posecast.model.head import DenseHead, Head
from posecast.model.lstm import LSTMBackbone
from posecast.model.pace import PaceNetwork
from posecast.model.parts_head import PartsHead
from posecast.model.predictor import ForecasterPredictor
from posecast.model.recurrent import Backbone, GRUBackbone, State, Summary
from posecast.model.rollout import Rollout, Session, Steppable, gated_rollout, rollout
from posecast.model.structural_rnn import StructuralRNNBackbone
from posecast.model.structured import StructuredHead

BACKBONES: dict[str, Callable[..., Backbone]] = {
    "convolutional": ConvolutionalBackbone,
    "early_reset_gru": EarlyResetGRUBackbone,
    "gru": GRUBackbone,
    "lstm": LSTMBackbone,
    "structural_rnn": StructuralRNNBackbone,
}
HEADS: dict[str, Callable[..., Head]] = {
    "dense": DenseHead,
    "parts": PartsHead,
    "structured": StructuredHead,
}

__all__ = [
    "BACKBONES",
    "HEADS",
    "Backbone",
    "BodyParts",
    "ControlLayers",
    "ConvolutionalBackbone",
    "DenseHead",
    "Discriminator",
    "EarlyResetGRUBackbone",
    "Forecaster",
    "ForecasterPredictor",
    "GRUBackbone",
    "Head",
    "LSTMBackbone",
    "MeanPose",
    "PaceNetwork",
    "PartsHead",
    "Prediction",
    "Residual",
    "Rollout",
    "RunningAverage",
    "Session",
    "State",
    "Steppable",
    "StructuralRNNBackbone",
    "StructuredHead",
    "Summary",
    "ZeroVelocity",
    "gated_rollout",
    "rollout",
]

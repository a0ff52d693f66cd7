"""Losses, feeds, window sampling, and a training run that can be killed and resumed."""

from posecast.training.adversary import Adversary
from posecast.training.comparison import Comparison
from posecast.training.feeding import FEEDS, Feed
from posecast.training.keeping import BEST, LAST, RUN_FILES, STATE, Best
from posecast.training.losses import LOSSES
from posecast.training.objective import Loss, Objective
from posecast.training.plan import Machines, Plan
from posecast.training.run import FitResult, fit
from posecast.training.sampling import SAMPLINGS, Sampling, Windows
from posecast.training.schedules import LearningRate, derived_generator, derived_seed
from posecast.training.step import training_loss

__all__ = [
    "BEST",
    "FEEDS",
    "LAST",
    "LOSSES",
    "RUN_FILES",
    "SAMPLINGS",
    "STATE",
    "Adversary",
    "Best",
    "Comparison",
    "Feed",
    "FitResult",
    "LearningRate",
    "Loss",
    "Machines",
    "Objective",
    "Plan",
    "Sampling",
    "Windows",
    "derived_generator",
    "derived_seed",
    "fit",
    "training_loss",
]

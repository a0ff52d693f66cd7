"""posecast: modelling human motion. See ``posecast --help`` and the README.

The names a user needs are here; each is imported when it is first asked for, so that importing
posecast, or asking the command line for help, loads neither PyTorch nor anything that trains.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from posecast.version import __version__ as __version__

if TYPE_CHECKING:
    from posecast.corpora import build_corpus
    from posecast.errors import ConfigError, DataError, PosecastError, SkeletonError
    from posecast.evaluation import build_protocol, evaluate
    from posecast.export import Stepper, export_step
    from posecast.forecast import forecast_clip
    from posecast.io import read_clip, write_clip
    from posecast.model import Forecaster, Session, rollout
    from posecast.motion import Clip, Motion
    from posecast.motion.corpus import Corpus
    from posecast.recipe import Recipe, list_recipes, load_recipe
    from posecast.skeleton import Skeleton
    from posecast.system import System, load, save, train

_HOMES = {
    "posecast.corpora": ("build_corpus",),
    "posecast.errors": ("ConfigError", "DataError", "PosecastError", "SkeletonError"),
    "posecast.evaluation": ("build_protocol", "evaluate"),
    "posecast.export": ("Stepper", "export_step"),
    "posecast.forecast": ("forecast_clip",),
    "posecast.io": ("read_clip", "write_clip"),
    "posecast.model": ("Forecaster", "Session", "rollout"),
    "posecast.motion": ("Clip", "Motion"),
    "posecast.motion.corpus": ("Corpus",),
    "posecast.recipe": ("Recipe", "list_recipes", "load_recipe"),
    "posecast.skeleton": ("Skeleton",),
    "posecast.system": ("System", "load", "save", "train"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Clip",
    "ConfigError",
    "Corpus",
    "DataError",
    "Forecaster",
    "Motion",
    "PosecastError",
    "Recipe",
    "Session",
    "Skeleton",
    "SkeletonError",
    "Stepper",
    "System",
    "build_corpus",
    "build_protocol",
    "evaluate",
    "export_step",
    "forecast_clip",
    "list_recipes",
    "load",
    "load_recipe",
    "read_clip",
    "rollout",
    "save",
    "train",
    "write_clip",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'posecast' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])

"""Whether a recipe and a corpus go together, asked before anything is trained."""

from __future__ import annotations

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.evaluation import METRICS
from posecast.motion.corpus import Corpus
from posecast.recipe.system_recipe import Recipe


def check_corpus(recipe: Recipe, corpus: Corpus) -> None:
    """Refuse a corpus that does not fit what is to be trained on it."""
    if corpus.fps != recipe.fps:
        raise ConfigError(
            f"{recipe.name} works at {recipe.fps:g} frames per second, the corpus has "
            f"{corpus.fps:g}; build it at {recipe.fps:g}"
        )
    _check_validation(recipe, corpus)
    _check_actions(recipe, corpus)


def _check_validation(recipe: Recipe, corpus: Corpus) -> None:
    """Refuse now what would come up at the first validation.

    Raises:
        ConfigError: the protocol does not fit the validation clips, or ``select_best_by`` is
            nothing that is measured.
    """
    wanted = recipe.plan.select_best_by
    if not corpus.splits.get("validation"):
        if wanted is not None:
            raise ConfigError(
                f"training.select_best_by: {wanted!r}, but corpus {corpus.name!r} has no "
                "validation clips to measure it on; leave it out"
            )
        if recipe.plan.patience is not None:
            raise ConfigError(
                f"training.patience: {recipe.plan.patience}, but corpus {corpus.name!r} has no "
                "validation clips to wait for; leave it out"
            )
        return
    protocol = recipe.protocol
    protocol.windows(corpus, "validation")
    errors = [metric for metric in protocol.metrics if not METRICS[metric].higher_is_better]
    if wanted is None and protocol.metrics[0] not in errors:
        raise ConfigError(
            f"protocol.metrics: the first, {protocol.metrics[0]!r}, would select the best "
            "checkpoint by its lowest value, but is better the higher it is; put an error first, "
            "or set training.select_best_by"
        )
    known = [
        *(metric for metric in protocol.metrics[:1] if metric in errors),
        *(f"{metric}_{ms:g}ms" for metric in errors for ms in protocol.horizons_ms),
    ]
    if wanted is not None and wanted not in known:
        raise ConfigError(
            f"training.select_best_by: validation measures no {wanted!r}; "
            f"{did_you_mean(wanted, known)}"
        )


def _check_actions(recipe: Recipe, corpus: Corpus) -> None:
    """Refuse clips of which the network could not be told what is done in them.

    Raises:
        ConfigError: naming the first.
    """
    known = recipe.build_codec(corpus.skeleton).actions
    if not known:
        return
    for index in (*corpus.splits["train"], *corpus.splits.get("validation", ())):
        clip = corpus.clips[index]
        action = clip.labels.get("action", "")
        if action not in known:
            raise ConfigError(
                f"codec.actions: clip {clip.name!r} "
                + (f"shows {action!r}" if action else "says of no action")
                + f", which is not listed; {did_you_mean(action, known)}"
            )

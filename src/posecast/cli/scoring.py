"""What ``posecast evaluate`` does: systems by name or folder on one corpus, under one protocol."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from posecast.cli.terminal import check_root, progress_bar
from posecast.config import did_you_mean
from posecast.corpora import build_corpus
from posecast.errors import ConfigError
from posecast.evaluation import BASELINES, Protocol, Report, build_protocol
from posecast.evaluation import evaluate as evaluate_predictors
from posecast.motion.corpus import Corpus
from posecast.system import System, load

BASELINE_FPS = 25.0  # where neither a protocol nor a checkpoint sets the rate


def score_systems(
    names: Sequence[str],
    *,
    corpus: str | None,
    root: Path | None,
    protocol: str | None,
    split: str,
) -> Report:
    """Score one baseline, or one or several runs of one system.

    Args:
        names: one of ``BASELINES``, or checkpoint folders of runs of one recipe.
        corpus: kind of corpus; ``None``: the one the system was trained on.
        root: folder of the corpus.
        protocol: name of the protocol; ``None``: the one of the system's recipe.
        split: which clips are scored.

    Raises:
        ConfigError: a baseline without a corpus, runs of different recipes, a name that is neither
            a baseline nor a folder.
    """
    if len(names) == 1 and names[0] in BASELINES:
        if corpus is None:
            raise ConfigError(f"{names[0]} was not trained on any corpus: name one with --corpus")
        chosen = build_protocol(protocol or "short-term")
        data = _read(corpus, root, chosen.fps or BASELINE_FPS)
        return evaluate_predictors(BASELINES[names[0]], chosen, data, system=names[0], split=split)
    for name in names:
        if name in BASELINES:
            raise ConfigError(
                f"{name!r} is a baseline, and all of them are in every table; name one alone, or "
                "checkpoint folders"
            )
        if not Path(name).is_dir() and Path(name).name == name:  # a path: loading it says more
            raise ConfigError(
                f"{name!r} is neither a checkpoint folder nor a baseline; "
                f"{did_you_mean(name, BASELINES)}"
            )
    systems = [load(name) for name in names]
    if len({system.recipe.name for system in systems}) > 1:
        raise ConfigError(
            "runs of different recipes: "
            + ", ".join(f"{n} ({s.recipe.name})" for n, s in zip(names, systems, strict=True))
            + "; evaluate one recipe at a time"
        )
    first = systems[0]
    data = _corpus_of(first, corpus, root)
    return evaluate_predictors(
        [system.predictor for system in systems],
        _protocol_of(first, protocol),
        data,
        system=first.recipe.name,
        split=split,
    )


def _protocol_of(system: System, protocol: str | None) -> Protocol:
    """The protocol by name, or the recipe's own with its options."""
    own = system.recipe.config["protocol"]["kind"]
    return system.recipe.protocol if protocol in (None, own) else build_protocol(str(protocol))


def _corpus_of(system: System, corpus: str | None, root: Path | None) -> Corpus:
    """The corpus by name, or the recipe's own with its options, at the system's frame rate."""
    own = system.recipe.config["corpus"]["kind"]
    if corpus in (None, own):
        check_root(own, root)
        with progress_bar(f"reading {own}") as advance:
            return system.recipe.build_corpus(root, progress=advance)
    return _read(str(corpus), root, system.fps)


def _read(kind: str, root: Path | None, fps: float) -> Corpus:
    check_root(kind, root)
    with progress_bar(f"reading {kind}") as advance:
        return build_corpus(kind, root=root, fps=fps, cache=None, progress=advance)

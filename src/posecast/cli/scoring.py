"""What ``posecast evaluate`` does: systems by name or folder on one corpus, under one protocol."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

from posecast.cli.terminal import check_root, progress_bar
from posecast.config import did_you_mean, parse_overrides
from posecast.corpora import build_corpus
from posecast.errors import ConfigError, SkeletonError
from posecast.evaluation import BASELINE_NAMES, Protocol, Report, build_protocol, make_baseline
from posecast.evaluation import evaluate as evaluate_predictors
from posecast.model.forecaster import Feedback
from posecast.motion.corpus import Corpus
from posecast.system import System, load

# Tried in turn where neither a protocol nor a checkpoint sets the rate.
BASELINE_FPS = (25.0, 30.0)


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
        names: one of ``BASELINE_NAMES``, or checkpoint folders of runs of one recipe; and options
            of corpus and protocol, such as ``protocol.joints=null``, and ``model.feedback``, which
            trained weights leave open.
        corpus: kind of corpus; ``None``: the one the system was trained on.
        root: folder of the corpus.
        protocol: name of the protocol; ``None``: the one of the system's recipe.
        split: which clips are scored.

    Raises:
        ConfigError: a baseline without a corpus, runs of different recipes, a name that is neither
            a baseline nor a folder, or an option of something else.
        SkeletonError: the corpus has other joints than the system.
    """
    names, options = options_of(names)
    if len(names) == 1 and names[0] in BASELINE_NAMES:
        if options["model"]:
            raise ConfigError(f"model.feedback: {names[0]} reads no predictions; leave it out")
        if corpus is None:
            raise ConfigError(f"{names[0]} was not trained on any corpus: name one with --corpus")
        chosen = build_protocol(**{"kind": protocol or "short-term", **options["protocol"]})
        data = _read(corpus, root, _rate(chosen), options["corpus"])
        baseline = make_baseline(names[0], data)
        return evaluate_predictors(baseline, chosen, data, system=names[0], split=split)
    for name in names:
        if name in BASELINE_NAMES:
            raise ConfigError(
                f"{name!r} is a baseline, and those of the protocol are in every table; name it "
                "alone, or checkpoint folders"
            )
        if not Path(name).is_dir() and Path(name).name == name:  # a path: loading it says more
            raise ConfigError(
                f"{name!r} is neither a checkpoint folder nor a baseline; "
                f"{did_you_mean(name, BASELINE_NAMES)}"
            )
    systems = [_reading(load(name), options["model"]) for name in names]
    if len({system.recipe.name for system in systems}) > 1:
        raise ConfigError(
            "runs of different recipes: "
            + ", ".join(f"{n} ({s.recipe.name})" for n, s in zip(names, systems, strict=True))
            + "; evaluate one recipe at a time"
        )
    first = systems[0]
    for name, system in zip(names, systems, strict=True):
        _check_same(names[0], first, name, system)
    check_seeds(names, systems)
    data = corpus_of(first, corpus, root, options["corpus"])
    check_skeleton(first, data)
    return evaluate_predictors(
        [system.predictor for system in systems],
        _protocol_of(first, protocol, options["protocol"]),
        data,
        system=first.recipe.name,
        split=split,
    )


def check_seeds(names: Sequence[str], systems: Sequence[System]) -> None:
    """Refuse to take one run for two."""
    seeds: dict[int, str] = {}
    for name, system in zip(names, systems, strict=True):
        seed = system.recipe.plan.seed
        if seed in seeds:
            raise ConfigError(
                f"{seeds[seed]} and {name} are of one run, or of two with one seed ({seed}), which "
                "has no spread; name one of them"
            )
        seeds[seed] = name


def _check_same(first_name: str, first: System, name: str, system: System) -> None:
    """Refuse to average over runs that differ in more than their seed."""
    one, other = (decisive(each) for each in (first, system))
    differing = sorted(key for key in {*one, *other} if one.get(key) != other.get(key))
    if differing:
        key = differing[0]
        raise ConfigError(
            f"{name} is no other run of {first_name}: {key} is {other.get(key)!r}, there "
            f"{one.get(key)!r}; evaluate them one at a time"
        )


def decisive(system: System) -> dict[str, object]:
    """What makes a system what it is, without its seed and how often it was looked at."""
    training = system.recipe.config["training"]
    looking = ("seed", "validate_every", "save_every", "select_best_by")
    own = {f"training.{key}": value for key, value in training.items() if key not in looking}
    return {**system.recipe.origin, **own, "skeleton": system.skeleton}


def check_skeleton(system: System, corpus: Corpus) -> None:
    """Refuse motion whose joints are not those the system was trained on."""
    wanted, found = system.skeleton, corpus.skeleton
    if wanted == found:
        return
    missing = [name for name in wanted.names if name not in found.names]
    extra = [name for name in found.names if name not in wanted.names]
    raise SkeletonError(
        f"corpus {corpus.name!r} has another skeleton than the system: it lacks "
        f"{', '.join(missing) or 'no joint'}; it has besides {', '.join(extra) or 'none'}"
        + ("" if missing or extra else "; the order or the tree differs")
        + "; score the system on the corpus it was trained on, or one with the same joints"
    )


def _protocol_of(system: System, protocol: str | None, options: Mapping[str, Any]) -> Protocol:
    """The protocol by name, or the recipe's own with its options; and with those given."""
    own = system.recipe.config["protocol"]
    begin = own if protocol in (None, own["kind"]) else {"kind": protocol}
    return build_protocol(**{**begin, **options})


def _rate(protocol: Protocol) -> float:
    """The protocol's frame rate, or the first of the usual ones that its times fall on."""
    if protocol.fps is not None:
        return protocol.fps
    for fps in BASELINE_FPS:
        try:
            protocol.frames(fps)
        except ConfigError:
            continue
        return fps
    return BASELINE_FPS[0]  # scoring says what does not fit


def corpus_of(
    system: System,
    corpus: str | None,
    root: Path | None,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> Corpus:
    """The corpus by name, or the recipe's own with its options; and with those given.

    At the system's frame rate.
    """
    own = dict(system.recipe.config["corpus"])
    kind = str(own.pop("kind"))
    begin = own if corpus in (None, kind) else {}
    return _read(kind if corpus is None else corpus, root, system.fps, {**begin, **options})


def _read(kind: str, root: Path | None, fps: float, options: Mapping[str, Any]) -> Corpus:
    check_root(kind, root)
    with progress_bar(f"reading {kind}") as advance:
        return build_corpus(kind, root=root, fps=fps, cache=None, progress=advance, **options)


def _is_option(argument: str) -> bool:
    """Whether an argument is no name of a system but ``key.path=value``."""
    return "=" in argument and not Path(argument).exists()


def options_of(arguments: Sequence[str]) -> tuple[list[str], dict[str, dict[str, Any]]]:
    """Names of systems, and what is given besides of corpus, protocol and model."""
    given = parse_overrides(argument for argument in arguments if _is_option(argument))
    for section, options in given.items():
        known = section in ("corpus", "protocol", "model") and isinstance(options, Mapping)
        if not known or (section == "model" and set(options) != {"feedback"}):
            raise ConfigError(
                f"{section}: scoring has options of corpus and protocol, such as "
                "protocol.joints=null, and model.feedback alone"
            )
        if "kind" in options:
            raise ConfigError(f"{section}.kind: give it as --{section}")
    names = [argument for argument in arguments if not _is_option(argument)]
    sections = ("corpus", "protocol", "model")
    return names, {section: dict(given.get(section, {})) for section in sections}


def _reading(system: System, options: Mapping[str, Any]) -> System:
    """The system, told how to read its own predictions where that is said."""
    feedback = options.get("feedback", system.forecaster.feedback)
    if feedback not in get_args(Feedback):
        raise ConfigError(
            f"model.feedback: {feedback!r} is not known; choose {' or '.join(get_args(Feedback))}"
        )
    system.forecaster.feedback = feedback
    return system

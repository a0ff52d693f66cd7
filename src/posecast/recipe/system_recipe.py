"""A recipe, the YAML of one system, checked whole and turned into its parts."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from posecast.config import check_call, check_keys, pick_kind
from posecast.corpora import COMMON, CORPORA, build_corpus
from posecast.corpora.gait.body import SKELETON
from posecast.corpora.walks import with_walks
from posecast.errors import ConfigError
from posecast.evaluation.protocol import Protocol
from posecast.evaluation.protocols import PROTOCOLS
from posecast.model import BACKBONES, HEADS, ControlLayers, Forecaster
from posecast.motion.corpus import Corpus
from posecast.recipe.codec_section import codec_of_section, steering
from posecast.representation import (
    REPRESENTATIONS,
    Codec,
    Representation,
    Statistics,
    build_representation,
)
from posecast.representation.root_channels import root_tracks
from posecast.skeleton import Skeleton
from posecast.skeleton.catalog import named_skeleton
from posecast.training.adversary import Adversary
from posecast.training.feeding import FEEDS, Feed
from posecast.training.objective import Objective
from posecast.training.plan import Plan
from posecast.training.sampling import SAMPLINGS, Sampling

MOST_FPS = 10_000
TEXTS = ("name", "summary", "source", "expect")
SECTIONS = ("fps", "corpus", "representation", "codec", "model", "training", "protocol")
MODEL_PARTS = ("backbone", "head", "controls")
TRAINING_PARTS = ("feed", "objective", "sampling", "adversary")

CORPUS_SKELETONS: Mapping[str, Callable[[], Skeleton]] = {
    "h36m": lambda: named_skeleton("h36m-32").skeleton,
    "synthetic": lambda: SKELETON,
    "cmu-asf": lambda: named_skeleton("cmu-31").skeleton,
    "amass": lambda: named_skeleton("smpl-22").skeleton,
    "amass-first": lambda: named_skeleton("smpl-22").skeleton,
}
"""Skeletons of corpora that are known before any file is read."""


@dataclass(frozen=True)
class Recipe:
    """One system: its parts by name, and their arguments.

    Args:
        config: the resolved sections, nested dictionaries; see ``TEXTS`` and ``SECTIONS``.

    Raises:
        ConfigError: a key that nobody reads, one that is missing, or a value of the wrong type.
    """

    config: Mapping[str, Any]

    def __post_init__(self) -> None:
        config = self.config
        self._check_top(config)
        missing = [section for section in (*TEXTS, *SECTIONS) if section not in config]
        if missing:
            raise ConfigError(f"{self.name}: {', '.join(missing)} must be given")
        for section in SECTIONS[1:]:
            if not isinstance(config[section], Mapping):
                raise ConfigError(f"{self._at(section)}: found {config[section]!r}, expected keys")
        fps = config["fps"]
        if isinstance(fps, bool) or not isinstance(fps, int | float) or not 0 < fps <= MOST_FPS:
            raise ConfigError(
                f"{self.name}.fps: found {fps!r}, expected a positive number, at most {MOST_FPS}"
            )
        self._check_kind(CORPORA, "corpus", COMMON)
        self._check_kind(REPRESENTATIONS, "representation", ("skeleton",))
        self._check_kind(PROTOCOLS, "protocol")
        check_call(
            codec_of_section,
            config["codec"],
            where=self._at("codec"),
            provided=("skeleton", "represent", "statistics"),
        )
        model = self._without("model", MODEL_PARTS)
        check_call(Forecaster, model, where=self._at("model"), provided=("codec", *MODEL_PARTS))
        self._check_kind(BACKBONES, "model.backbone", ("input_dim", "skeleton", "joint_dim"))
        self._check_kind(HEADS, "model.head", ("context_dim", "skeleton", "joint_dim", "body"))
        self._check_controls()
        check_call(Plan, self._without("training", TRAINING_PARTS), where=self._at("training"))
        self._check_kind(FEEDS, "training.feed")
        self._check_kind(SAMPLINGS, "training.sampling")
        check_call(Objective, self._objective, where=self._at("training.objective"))
        if config["training"].get("adversary") is not None:
            place = "training.adversary"
            check_call(Adversary, self._section(place), where=self._at(place))
        # Built here only for their own checks: all six are small values.
        _ = self.plan, self.feed, self.sampling, self.objective, self.adversary, self.protocol
        self._check_network()

    def _check_controls(self) -> None:
        """Refuse controls that nothing prepares, and layers that nothing reaches."""
        layers, made = self.config["model"].get("controls"), self.config["codec"].get("controls")
        if layers is not None:
            place = "model.controls"
            check_call(
                ControlLayers,
                self._section(place),
                where=self._at(place),
                provided=("input_dim",),
            )
        if (layers is None) != (made is None):
            found, absent = ("model", "codec") if made is None else ("codec", "model")
            raise ConfigError(
                f"{self.name}: {found}.controls is given and {absent}.controls is not; "
                "codec.controls says what steers, model.controls the layers that prepare it ({}: "
                "the published ones); give both or neither"
            )

    def _check_top(self, config: Mapping[str, Any]) -> None:
        """Refuse keys at the top that belong there as little as elsewhere, or only elsewhere."""
        for key in config:
            if key in (*TEXTS, *SECTIONS):
                continue
            deeper = [
                *(f"training.{name}" for name in inspect.signature(Plan).parameters),
                *_flat({section: config.get(section, {}) for section in SECTIONS[1:]}),
            ]
            places = [place for place in deeper if place.rpartition(".")[2] == key]
            if places:
                raise ConfigError(
                    f"{self.name}.{key}: unknown key at the top; did you mean {places[0]!r}?"
                )
        check_keys(config, (*TEXTS, *SECTIONS), self.name)

    @property
    def name(self) -> str:
        """What the system is called in tables and messages."""
        return str(self.config.get("name", "recipe"))

    @property
    def fps(self) -> float:
        """Frames per second at which the system works."""
        return float(self.config["fps"])

    @property
    def plan(self) -> Plan:
        """How the forecaster is trained."""
        return self._named("training", lambda: Plan(**self._without("training", TRAINING_PARTS)))

    @property
    def feed(self) -> Feed:
        """Which steps of a training rollout read the truth."""
        return self._named("training.feed", lambda: self._build(FEEDS, "training.feed"))

    @property
    def sampling(self) -> Sampling:
        """Which recordings an epoch sees."""
        return self._named("training.sampling", lambda: self._build(SAMPLINGS, "training.sampling"))

    @property
    def objective(self) -> Objective:
        """What training descends."""
        return self._named("training.objective", lambda: Objective(**self._objective))

    @property
    def adversary(self) -> Adversary | None:
        """Discriminators that judge the forecaster in training, if the recipe has a section."""
        if self.config["training"].get("adversary") is None:
            return None
        section = self._section("training.adversary")
        return self._named("training.adversary", lambda: Adversary(**section))

    @property
    def _objective(self) -> dict[str, Any]:
        """The arguments of the objective; a weight of null leaves out an extended recipe's term."""
        section = dict(self._section("training.objective"))
        terms = section.get("terms")
        if isinstance(terms, Mapping):
            section["terms"] = {key: weight for key, weight in terms.items() if weight is not None}
        return section

    @property
    def origin(self) -> dict[str, Any]:
        """What the corpus and the network are built from, by dotted names."""
        return _flat(
            {key: self.config[key] for key in SECTIONS if key not in ("training", "protocol")}
        )

    @property
    def protocol(self) -> Protocol:
        """How the system is scored."""
        return self._named("protocol", lambda: self._build(PROTOCOLS, "protocol"))

    def build_corpus(
        self,
        root: Path | None = None,
        *,
        cache: Path | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Corpus:
        """Read the corpus, at the frame rate of the system; its gait is analysed where the network
        is steered or follows a path.

        Args:
            root: folder of the recordings; a corpus that is generated needs none.
            cache: where parsed recordings are kept; ``None``: the user's cache folder.
            progress: called with (files done, files in all).
        """
        options = dict(self.config["corpus"])
        corpus = build_corpus(
            options.pop("kind"), root=root, fps=self.fps, cache=cache, progress=progress, **options
        )
        section = self.config["codec"]
        controls = section.get("controls")
        if controls is None and not root_tracks(section.get("root", "none")):
            return corpus
        return with_walks(corpus, () if controls is None else steering(controls).styles)

    def build_codec(self, skeleton: Skeleton, statistics: Statistics | None = None) -> Codec:
        """How motion becomes features.

        Args:
            skeleton: whose motion.
            statistics: what the network standardizes by: see ``measure``.
        """
        options = dict(self.config["representation"])
        kind = options.pop("kind")

        def represent(written: Skeleton) -> Representation:
            return build_representation(kind, written, **options)

        return codec_of_section(skeleton, represent, statistics, **self.config["codec"])

    def measure(self, corpus: Corpus) -> Statistics | None:
        """Statistics of the training split; ``None`` if the recipe does not standardize.

        Recordings are cut into pieces as long as windows are, so that the signs of quaternions
        wander from where they begin as far as in training, and no farther.
        """
        divide_by = self.config["codec"].get("standardize", "none")
        if divide_by == "none":
            return None
        plain, length = self.build_codec(corpus.skeleton), self.plan.prefix + self.plan.horizon
        pieces = (
            clip.cut(start, min(start + length, clip.frames)).motion()
            for clip in corpus.split("train")
            for start in range(0, clip.frames, length)
        )
        return plain.measure(pieces, divide_by=divide_by)

    def build_forecaster(self, codec: Codec) -> Forecaster:
        """The network, its weights drawn from the recipe's seed by PyTorch's own generator."""
        model = self.config["model"]
        controls = model.get("controls")
        return Forecaster(
            codec,
            backbone=self._maker(BACKBONES, "model.backbone"),
            head=self._maker(HEADS, "model.head"),
            controls=(
                None
                if controls is None or codec.controls is None
                else ControlLayers(codec.controls.dim, **controls)
            ),
            **self._without("model", MODEL_PARTS),
        )

    def outline(self, codec: Codec) -> Forecaster:
        """The network's shapes without its values: nothing is allocated, whatever its size.

        Raises:
            ConfigError: sizes that no network can have.
        """
        try:
            with torch.device("meta"):
                return self._named("model", lambda: self.build_forecaster(codec))
        except (ValueError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise ConfigError(f"{self._at('model')}: {reason}; check its sizes") from None

    def _check_network(self) -> None:
        """Let the parts of the network be checked together, before any data is read.

        On the skeleton of the corpus if it is known beforehand, and on another if nothing in the
        recipe names joints.
        """
        corpus = str(self.config["corpus"]["kind"])
        model = self.config["model"]
        names_joints = (
            self.config["codec"].get("joints")
            or isinstance(model["head"].get("tree"), Mapping)
            or model["backbone"].get("parts")
        )
        if corpus not in CORPUS_SKELETONS and names_joints:
            return
        skeleton = CORPUS_SKELETONS.get(corpus, lambda: named_skeleton("h36m-32").skeleton)()
        codec = self._named("codec", lambda: self.build_codec(skeleton))
        self.outline(codec)
        self._named("training.objective", lambda: self.objective.check(codec))

    def _section(self, place: str) -> Mapping[str, Any]:
        """The section at a dotted place."""
        found: Any = self.config
        for key in place.split("."):
            found = found.get(key) if isinstance(found, Mapping) else None
        if not isinstance(found, Mapping):
            raise ConfigError(f"{self._at(place)}: found {found!r}, expected a section of keys")
        return found

    def _without(self, section: str, parts: Sequence[str]) -> dict[str, Any]:
        """A section's own arguments, its parts left out."""
        return {key: value for key, value in self.config[section].items() if key not in parts}

    def _check_kind(
        self, table: Mapping[str, Callable[..., Any]], place: str, provided: Sequence[str] = ()
    ) -> None:
        """Check the section at ``place`` against the member of ``table`` it names."""
        factory, arguments = pick_kind(table, self._section(place), self._at(place))
        check_call(factory, arguments, where=self._at(place), provided=provided)

    def _build(self, table: Mapping[str, Callable[..., Any]], place: str) -> Any:
        """The part that the section at ``place`` names, built."""
        return self._maker(table, place)()

    def _maker(self, table: Mapping[str, Callable[..., Any]], place: str) -> Callable[..., Any]:
        """What makes the part that the section at ``place`` names, from what is not said there."""
        factory, options = pick_kind(table, self._section(place), self._at(place))
        return partial(factory, **options)

    def _named(self, place: str, build: Callable[[], Any]) -> Any:
        """``build()``, with the place in the recipe before what it complains about."""
        try:
            return build()
        except ConfigError as error:
            raise ConfigError(f"{self._at(place)}: {error}") from None

    def _at(self, place: str) -> str:
        return f"{self.name}: {place}"


def _flat(section: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested keys as dotted ones."""
    flat: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat

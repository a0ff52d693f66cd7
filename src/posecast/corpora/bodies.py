"""Several bodies at once: the motions of another corpus on bodies seen in training and unseen ones.

Andreou et al. 2022, section 7.3, trains one network on people of different proportions without
retargeting. Here the truth on a body that never moved so is known exactly: it is the body that the
motion's own rotations are given (``motion.reproportion``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.corpora.cmu import ASF_TRIALS, asf_trials, cmu_salsa
from posecast.corpora.gait.body import CAST
from posecast.corpora.loading import Cache, Progress
from posecast.corpora.synthetic import synthetic
from posecast.errors import ConfigError, DataError
from posecast.motion import Clip, Corpus, reproportion, scale_body

OWN = "own"
"""The body that a motion was recorded on, where all have one."""

MADE_BODIES: Mapping[str, Mapping[str, float]] = {
    "child": {"all": 0.7, "legs": 0.92, "head": 1.3},
    "giant": {"all": 1.3},
    "long-arms": {"arms": 1.35},
    "short-legs": {"legs": 0.75},
    "youth": {"all": 0.85},
}
"""Bodies made from a recorded one: factors of its parts, see ``scale_body``."""

UNSEEN: Mapping[str, tuple[str, ...]] = {
    "synthetic": ("average", "tall"),
    "cmu-salsa": ("giant", "youth"),
    "cmu-asf": ("03",),
}
"""By the corpus built on: bodies left out of training unless others are named."""

ASF_VALIDATION = ("01/01_09.amc", "02/02_08.amc", "03/03_02.amc")
ASF_TEST = ("01/01_07.amc", "01/01_13.amc", "02/02_02.amc", "02/02_09.amc", "03/03_04.amc")
"""Trials held out of training, each of which has a like there."""

_KNOWN: Mapping[str, tuple[str, ...]] = {
    "synthetic": tuple(body.name for body in CAST),
    "cmu-salsa": (OWN, *MADE_BODIES),
    "cmu-asf": tuple(ASF_TRIALS),
}

_Names = str | int | Sequence[str | int]
"""One or several; a whole number is what YAML makes of an unquoted 03."""


class _Material(NamedTuple):
    """What a corpus of several bodies is made from.

    Args:
        corpus: motions.
        bodies: offsets by name.
        owners: for each clip the body that it was recorded on.
        uses: for each clip what its motion is for, by split.
        crossed: whether every motion is for every body, or only for its own while that is seen.
        notes: full sentences.
    """

    corpus: Corpus
    bodies: Mapping[str, Float[Tensor, "joints 3"]]
    owners: Sequence[str]
    uses: Sequence[str | None]
    crossed: bool
    notes: tuple[str, ...] = ()


class _Group(NamedTuple):
    """Clips on one body: the split they are in, their label, and indices of their motions."""

    split: str
    body: str
    scenario: str
    motions: list[int]


def bodies(
    root: Path | str | None = None,
    *,
    of: str = "synthetic",
    unseen: _Names | None = None,
    group_size: int = 6,
    fps: float | int | None = None,
    cache: Cache = None,
    progress: Progress | None = None,
    workers: int = 0,
    clips: int | None = None,
    seconds: float | int | None = None,
    seed: int | None = None,
) -> Corpus:
    """Motions of another corpus on several bodies, some of which training never sees.

    Training has seen bodies and seen motions; validation has seen bodies with other motions. The
    test has groups by the label ``scenario``, one for each body, such as "seen body (child),
    unseen motion", "unseen body (tall), seen motion", "unseen body (tall), unseen motion": an
    unseen motion occurs in training on no body.

    Built on ``synthetic``, the bodies are its cast; on ``cmu-salsa``, the dancer's own and
    ``MADE_BODIES``. Every motion is given every body, and groups of one kind have the same
    motions, so that they differ in the body alone. Built on ``cmu-asf``, the bodies are subjects
    01, 02 and 03, and training has each person's trials on that person's body only. What the
    person of an unseen body did is a further group, "unseen body (03), unseen motion of its own
    person": there the mover is a stranger, too.

    Further labels: ``body``, and ``motion``, which is the same for a motion on all bodies.

    Args:
        root: folder of the files of that corpus; the synthetic one has none.
        of: what is built on: ``synthetic``, ``cmu-salsa`` or ``cmu-asf``.
        unseen: one body or several; by default ``UNSEEN``: where these are two, one is between
            seen bodies in size, the other taller than all of them.
        group_size: at most so many clips in each group of validation and test.
        fps: frames per second, by default as in that corpus.
        cache: see ``loading.Cache``.
        progress: called with files read and files in all.
        workers: see ``loading.load``.
        clips, seconds, seed: as of ``synthetic``, for that only.

    Raises:
        ConfigError: an unknown corpus or body, no body left to see, a group of no clips, no
            ``root``, or options of ``synthetic`` for another corpus.
        DataError: files are missing or cannot be read.
    """
    if of not in _KNOWN:
        raise ConfigError(f"bodies: of {of!r} is not known; {did_you_mean(of, _KNOWN)}")
    hidden = _unseen_bodies(of, unseen)
    if group_size < 1:
        raise ConfigError(f"bodies: group_size {group_size}; expected 1 or more")
    options = {"fps": fps, "clips": clips, "seconds": seconds, "seed": seed}
    given: dict[str, Any] = {key: value for key, value in options.items() if value is not None}
    if of == "synthetic":
        return _assemble(_of_synthetic(synthetic(**given)), hidden, group_size)
    if given.keys() - {"fps"}:
        wrong = ", ".join(key for key in given if key != "fps")
        raise ConfigError(f"bodies: {wrong} cannot be chosen of {of}, only of synthetic")
    if root is None:
        raise ConfigError(f"bodies of {of} are read from files: give root, the folder they are in")
    given |= {"cache": cache, "progress": progress, "workers": workers}
    if of == "cmu-salsa":
        return _assemble(_of_salsa(cmu_salsa(root, **given)), hidden, group_size)
    material = _of_asf(asf_trials(root, **given))
    if not set(hidden) < set(material.bodies):
        there = ", ".join(sorted(material.bodies))
        raise DataError(
            root, f"bodies {there} are there; expected {', '.join(hidden)}, unseen, and another"
        )
    return _assemble(material, hidden, group_size)


def _unseen_bodies(of: str, unseen: _Names | None) -> tuple[str, ...]:
    """Names of the bodies left out of training, once each, in the order of all."""
    named = UNSEEN[of] if unseen is None else unseen
    listed = [named] if isinstance(named, str | int) else named
    chosen = [f"{name:02d}" if isinstance(name, int) else name for name in listed]
    for name in chosen:
        if name not in _KNOWN[of]:
            raise ConfigError(
                f"bodies: unseen body {name!r} is none of {of}; {did_you_mean(name, _KNOWN[of])}"
            )
    if not 0 < len(set(chosen)) < len(_KNOWN[of]):
        raise ConfigError(
            f"bodies: {len(set(chosen))} of the {len(_KNOWN[of])} bodies of {of} are unseen; "
            "expected at least one, and one that is seen"
        )
    return tuple(name for name in _KNOWN[of] if name in chosen)


def _of_synthetic(corpus: Corpus) -> _Material:
    return _Material(
        corpus,
        bodies={body.name: body.offsets for body in CAST},
        owners=[clip.labels["body"] for clip in corpus.clips],
        uses=_uses(corpus),
        crossed=True,
    )


def _of_salsa(corpus: Corpus) -> _Material:
    own = corpus.clips[0].offsets
    made = {
        name: scale_body(corpus.skeleton, own, factors) for name, factors in MADE_BODIES.items()
    }
    return _Material(
        corpus,
        bodies={OWN: own, **made},
        owners=[OWN for _ in corpus.clips],
        uses=_uses(corpus),
        crossed=True,
        notes=(f"Bodies other than {OWN!r} are made from it by scaling its parts.",),
    )


def _of_asf(corpus: Corpus) -> _Material:
    held_out = dict.fromkeys(ASF_VALIDATION, "validation") | dict.fromkeys(ASF_TEST, "test")
    return _Material(
        corpus,
        bodies={clip.labels["subject"]: clip.offsets for clip in corpus.clips},
        owners=[clip.labels["subject"] for clip in corpus.clips],
        uses=[held_out.get(clip.labels["file"], "train") for clip in corpus.clips],
        crossed=False,
        notes=(
            f"Held out for validation: {', '.join(ASF_VALIDATION)}; for the test: "
            f"{', '.join(ASF_TEST)}; of a person whose body is unseen, all trials.",
            "Training has each person on their own body. Their rest poses differ by up to 14 "
            "degrees in the direction of a bone, so a borrowed body changes poses by that much.",
        ),
    )


def _uses(corpus: Corpus) -> list[str | None]:
    uses: list[str | None] = [None] * len(corpus.clips)
    for split, indices in corpus.splits.items():
        for index in indices:
            uses[index] = split
    return uses


def _assemble(material: _Material, hidden: Sequence[str], group_size: int) -> Corpus:
    """The corpus: every group's clips on its body."""
    corpus = material.corpus
    clips: list[Clip] = []
    splits: dict[str, tuple[int, ...]] = {"train": (), "validation": (), "test": ()}
    for group in _groups(material, hidden, group_size):
        splits[group.split] += tuple(range(len(clips), len(clips) + len(group.motions)))
        clips += [_dress(material, index, group) for index in group.motions]
    notes = (
        *corpus.notes,
        f"Seen bodies: {', '.join(name for name in material.bodies if name not in hidden)}; "
        f"unseen: {', '.join(hidden)}.",
        "A clip on a body that is not its own has the same local rotations, and root positions "
        "scaled about the floor by how much longer the legs are: its truth is exact, its feet are "
        "near the floor but not fixed to it.",
        f"A group of validation or test has at most {group_size} clips, spread over the actions.",
        *material.notes,
    )
    return Corpus(f"bodies of {corpus.name}", clips, splits, corpus.missing, notes)


def _groups(material: _Material, hidden: Sequence[str], group_size: int) -> Iterator[_Group]:
    """Which motions go on which body, and what for."""
    clips, owners, crossed = material.corpus.clips, material.owners, material.crossed
    firsts = {i for i, clip in enumerate(clips) if clip.labels.get("phase", "0") == "0"}
    known = [i for i, owner in enumerate(owners) if crossed or owner not in hidden]
    train = [i for i in known if material.uses[i] == "train"]
    held_out = {
        use: [i for i in known if i in firsts and material.uses[i] == use]
        for use in ("validation", "test")
    }

    def some(motions: Sequence[int]) -> list[int]:
        return _spread(motions, [clips[i].labels.get("action", "") for i in motions], group_size)

    for body in material.bodies:
        if body not in hidden:
            chosen = [i for i in train if crossed or owners[i] == body]
            yield _Group("train", body, f"seen body ({body}), seen motion", chosen)
            for use, motions in held_out.items():
                chosen = some([i for i in motions if crossed or owners[i] == body])
                yield _Group(use, body, f"seen body ({body}), unseen motion", chosen)
            continue
        unseen = f"unseen body ({body})"
        chosen = some([i for i in train if i in firsts])
        yield _Group("test", body, f"{unseen}, seen motion", chosen)
        yield _Group("test", body, f"{unseen}, unseen motion", some(held_out["test"]))
        if not crossed:
            chosen = some([i for i in sorted(firsts) if owners[i] == body])
            yield _Group("test", body, f"{unseen}, unseen motion of its own person", chosen)


def _spread(motions: Sequence[int], kinds: Sequence[str], most: int) -> list[int]:
    """At most so many motions, of every kind about the same share, in their order."""
    by_kind = [motion for _, motion in sorted(zip(kinds, motions, strict=True))]
    count = min(most, len(by_kind))
    return sorted(by_kind[(2 * place + 1) * len(by_kind) // (2 * count)] for place in range(count))


def _dress(material: _Material, index: int, group: _Group) -> Clip:
    """A clip on the body of a group; on its own it is the recording itself."""
    clip, body = material.corpus.clips[index], group.body
    labels = {"motion": clip.labels.get("file", clip.name), "scenario": group.scenario}
    if material.owners[index] == body:
        return replace(clip, labels={**clip.labels, **labels, "body": body})
    worn = reproportion(clip, material.bodies[body], body=body)
    return replace(worn, name=f"{clip.name} on {body}", labels={**worn.labels, **labels})

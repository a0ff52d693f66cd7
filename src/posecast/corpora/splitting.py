"""Which file and which clip is for training, validation or testing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from posecast.config import check_keys, read_yaml
from posecast.errors import ConfigError
from posecast.motion import Clip

SPLITS = ("train", "validation", "test")
SPLITS_FILE = "splits.yaml"

Globs = Mapping[str, str | Sequence[str]]
"""For train, validation, test one or several patterns of paths; ``*`` stands for anything."""


def split_clips(
    clips: Sequence[Clip], split_of: Callable[[Clip], str | None]
) -> dict[str, tuple[int, ...]]:
    """Indices of the clips for each split, in their order.

    Training has every phase of a clip that was brought to a lower frame rate. Validation and test
    have the first alone: the others are nearly the same motion again.

    Args:
        clips: of a corpus.
        split_of: what a clip is for; ``None``: for nothing.
    """
    splits: dict[str, list[int]] = {split: [] for split in SPLITS}
    for index, clip in enumerate(clips):
        split = split_of(clip)
        if split == "train" or (split and clip.labels.get("phase", "0") == "0"):
            splits[split].append(index)
    return {split: tuple(indices) for split, indices in splits.items()}


def tenths(names: Sequence[str]) -> dict[str, str]:
    """Split names in their order: the last tenth is the test, the tenth before validation.

    A tenth is rounded to whole names and at least one, as long as one is left for training: of
    two names the second is the test, a single one is for training.
    """
    tenth = max(1, (len(names) + 5) // 10)
    test = max(0, min(tenth, len(names) - 1))
    validation = max(0, min(tenth, len(names) - 1 - test))
    train = len(names) - test - validation
    kinds = ["train"] * train + ["validation"] * validation + ["test"] * test
    return dict(zip(names, kinds, strict=True))


def choose_splits(
    names: Sequence[str],
    root: Path,
    splits: Path | str | Globs | None,
    otherwise: Callable[[Sequence[str]], Mapping[str, str]],
    rule: str,
) -> tuple[dict[str, str], str]:
    """What each file is for, and a sentence on how that was decided.

    Args:
        names: paths below the folder of the corpus.
        root: that folder; if it holds ``splits.yaml``, that is used.
        splits: patterns, or a YAML file with them; goes before all else.
        otherwise: the rule of the corpus.
        rule: a sentence on that rule.

    Raises:
        ConfigError: see ``match_globs``; or a YAML file that cannot be read.
    """
    if splits is None and (root / SPLITS_FILE).is_file():
        splits = root / SPLITS_FILE
    if splits is None:
        return dict(otherwise(names)), rule
    if isinstance(splits, Mapping):
        globs, where = splits, "splits"
    else:
        globs, where = read_yaml(Path(splits)), str(splits)
    chosen = match_globs(names, globs, where)
    left_out = len(names) - len(chosen)
    return chosen, f"Split by {where}; {left_out} of {len(names)} files are not named, not used."


def match_globs(names: Sequence[str], globs: Mapping[str, object], where: str) -> dict[str, str]:
    """Which split each name is in by patterns; names that match none are left out.

    Args:
        names: paths below the folder of the corpus.
        globs: see ``Globs``.
        where: what to call them in messages.

    Raises:
        ConfigError: another split, a pattern that matches nothing, a name in two splits.
    """
    check_keys(globs, SPLITS, where)
    chosen: dict[str, str] = {}
    for split, patterns in globs.items():
        for pattern in _listed(patterns, f"{where}.{split}"):
            matched = [name for name in names if fnmatchcase(name, pattern)]
            if not matched:
                raise ConfigError(
                    f"{where}.{split}: {pattern!r} matches none of {len(names)} files, "
                    f"such as {names[0]}"
                )
            for name in matched:
                if chosen.setdefault(name, split) != split:
                    raise ConfigError(
                        f"{where}: {name} is in {chosen[name]} and, by {pattern!r}, in {split}; "
                        "a file is for one of them"
                    )
    if not chosen:
        raise ConfigError(f"{where}: names no file; give patterns for {', '.join(SPLITS)}")
    return chosen


def _listed(patterns: object, where: str) -> Sequence[str]:
    if isinstance(patterns, str):
        return [patterns]
    if isinstance(patterns, Sequence) and all(isinstance(pattern, str) for pattern in patterns):
        return patterns
    raise ConfigError(f"{where}: found {patterns!r}, expected a pattern or a list of them")

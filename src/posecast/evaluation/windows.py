"""Which windows a protocol looks at: the draws of the Human3.6M literature, and a plain grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from posecast.errors import ConfigError, DataError
from posecast.motion.clip import Clip
from posecast.motion.corpus import Corpus, Window

H36M_ACTIONS = (
    "walking",
    "eating",
    "smoking",
    "discussion",
    "directions",
    "greeting",
    "phoning",
    "posing",
    "purchases",
    "sitting",
    "sittingdown",
    "takingphoto",
    "waiting",
    "walkingdog",
    "walkingtogether",
)

# Fixed by the code of Martinez et al. (CVPR 2017); every later system on these windows repeats it.
LEGACY_SEED = 1234567890
LEGACY_FIRST = 16
LEGACY_RESERVE = 150  # 50 frames of prefix + 100 of suffix, whatever is really predicted


class Group(NamedTuple):
    """The windows behind one line of a table.

    Args:
        name: the action, or ``all`` where clips carry no such label.
        windows: clip (index into the corpus) and first frame of each window, in a fixed order.
    """

    name: str
    windows: tuple[Window, ...]


class Sampling(NamedTuple):
    """All windows of a protocol on a corpus.

    Args:
        groups: one an action, in the order of the table.
        expected: how many groups there would be if no file were missing.
        missing: files that would have been needed, as ``S5/walking_1.txt``.
        notes: what else was left out and why, and how the windows were chosen; full sentences.
    """

    groups: tuple[Group, ...]
    expected: int
    missing: tuple[str, ...]
    notes: tuple[str, ...]


def legacy_starts(frames: tuple[int, int], pairs: int) -> tuple[tuple[int, int], ...]:
    """Draws of the Human3.6M short-term protocol for one action.

    A new legacy generator, then alternately one start in recording 1 and one in recording 2, each
    uniform over 16 <= start < frames - 150. The first ``n`` pairs do not depend on ``pairs``.

    Args:
        frames: lengths of the two recordings at 25 fps (the even frames of 50).
        pairs: 4 in the standard protocol, 128 in the one proposed by Pavllo et al. (IJCV 2019).

    Returns:
        ``2 * pairs`` times (recording, start), recording 0 or 1.

    Source: Martinez et al., CVPR 2017 (code); Pavllo et al., IJCV 2019, Tables 1 and 2.
    """
    # The published windows are those of the old generator, so the new one would not do.
    draw = np.random.RandomState(LEGACY_SEED)
    return tuple(
        (recording, int(draw.randint(LEGACY_FIRST, length - LEGACY_RESERVE)))
        for _ in range(pairs)
        for recording, length in enumerate(frames)
    )


@dataclass(frozen=True)
class LegacyDraws:
    """The legacy draws for each action of which both recordings are there.

    Clips are found by their labels ``action`` and ``recording`` (``1`` or ``2``).

    Args:
        pairs: windows a recording; an action has twice as many.
        actions: lines of the table, in its order; all must be there for the published average.
    """

    pairs: int
    actions: tuple[str, ...] = H36M_ACTIONS

    def sample(self, corpus: Corpus, split: str, length: int) -> Sampling:
        """Draw the windows; ``length`` frames must fit into what the draws keep free.

        Raises:
            ConfigError: the window is too long, or the split has no complete action, or more than
                one subject or phase of it.
            DataError: a recording is too short to draw from.
        """
        if length > LEGACY_RESERVE:
            raise ConfigError(
                f"windows of {length} frames; these draws keep only {LEGACY_RESERVE} frames free "
                "before the end of a recording, so use horizons up to 4000 ms"
            )
        found = self._recordings(corpus, split)
        folder = _folder(corpus, tuple(found.values()))
        groups: list[Group] = []
        missing: list[str] = []
        for action in self.actions:
            places = [(action, "1"), (action, "2")]
            absent = [
                f"{folder}{action}_{number}.txt"
                for _, number in places
                if (action, number) not in found
            ]
            missing += absent
            if not absent:
                groups.append(
                    Group(action, _draw(corpus, (found[places[0]], found[places[1]]), self.pairs))
                )
        if not groups:
            raise ConfigError(
                f"split {split!r} of corpus {corpus.name!r} has no action with both recordings; "
                f"this protocol needs Human3.6M clips labelled with recording (1, 2) and action "
                f"({', '.join(self.actions)}); for other corpora use protocol 'short-term'"
            )
        notes = [
            f"{2 * self.pairs} windows an action, {self.pairs} in either recording, "
            f"drawn with the legacy generator, seed {LEGACY_SEED}."
        ]
        left_out = sorted(set(self.actions) - {group.name for group in groups})
        if left_out:
            notes.append(f"Left out because a recording is missing: {', '.join(left_out)}.")
        return Sampling(tuple(groups), len(self.actions), tuple(missing), tuple(notes))

    def _recordings(self, corpus: Corpus, split: str) -> dict[tuple[str, str], int]:
        """Index of the clip of each (action, recording)."""
        found: dict[tuple[str, str], int] = {}
        for index in corpus.indices(split):
            labels = corpus.clips[index].labels
            if not {"action", "recording"} <= set(labels):
                raise ConfigError(
                    f"corpus {corpus.name!r}: its clips are not labelled with action and recording "
                    "as those of Human3.6M are; use protocol 'short-term'"
                )
            place = labels["action"], labels["recording"]
            if place in found:
                raise ConfigError(
                    f"split {split!r} of corpus {corpus.name!r} holds recording {place[1]!r} of "
                    f"{place[0]!r} more than once; these windows need one subject, and of the "
                    "50 fps recordings only the even frames"
                )
            found[place] = index
        return found


def grid_starts(frames: int, length: int, stride: int) -> range:
    """First frames 0, stride, 2 stride ... of all windows that fit; empty for a short clip."""
    return range(0, max(frames - length + 1, 0), stride)


@dataclass(frozen=True)
class Grid:
    """Windows on a regular grid over every clip of a split, grouped by a label of the clips.

    Args:
        stride: frames from the start of one window to that of the next.
        group_by: label to group by; clips without it are grouped as ``all``, and all clips are with
            ``None``.
        limit: most windows of a group, spread evenly over all on the grid; ``None``: all of them.
        least: windows begin only where so many frames are left, however few of them are used, so
            that they are the same whatever the horizons; ``None``: as many as are used.

    Raises:
        ConfigError: a stride or a limit below one.
    """

    stride: int
    group_by: str | None = "action"
    limit: int | None = None
    least: int | None = None

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise ConfigError(f"windows on a grid, stride {self.stride}; expected at least 1 frame")
        if self.limit is not None and self.limit < 1:
            raise ConfigError(
                f"windows on a grid, limit {self.limit}; expected at least 1, or none"
            )

    def sample(self, corpus: Corpus, split: str, length: int) -> Sampling:
        """All windows of ``length`` frames on the grid.

        Raises:
            ConfigError: they are longer than what is kept for them, or no clip of the split is as
                long.
        """
        if self.least is not None and length > self.least:
            raise ConfigError(
                f"windows of {length} frames, prefix and horizon together; those of this protocol "
                f"have {self.least}: shorten the horizons"
            )
        length = self.least or length
        grouped: dict[str, list[Window]] = {}
        short: list[str] = []
        indices = corpus.indices(split)
        if not indices:
            raise ConfigError(
                f"split {split!r} of corpus {corpus.name!r} is empty; it needs more recordings, or "
                "other splits (a splits.yaml in the folder)"
            )
        for index in indices:
            clip = corpus.clips[index]
            starts = grid_starts(clip.frames, length, self.stride)
            if not starts:
                short.append(clip.name or f"clip {index}")
                continue
            name = "all" if self.group_by is None else clip.labels.get(self.group_by, "all")
            grouped.setdefault(name, []).extend(Window(clip=index, start=start) for start in starts)
        if not grouped:
            raise ConfigError(
                f"split {split!r} of corpus {corpus.name!r}: none of its {len(indices)} clips has "
                f"the {length} frames of a window; shorten the prefix or the horizons"
            )
        notes = [
            f"{sum(map(len, grouped.values()))} windows of {length} frames, one every "
            f"{self.stride} frames, in {len(indices) - len(short)} clips of split '{split}'."
        ]
        for name, windows in grouped.items():
            if self.limit is not None and len(windows) > self.limit:
                notes.append(
                    f"Of the {len(windows)} windows of {name!r}, {self.limit} spread evenly over "
                    "them are taken."
                )
                grouped[name] = _spread(windows, self.limit)
        if short:
            notes.append(f"Left out because shorter than a window: {_some(short)}.")
        groups = tuple(Group(name, tuple(grouped[name])) for name in sorted(grouped))
        return Sampling(groups, len(groups), corpus.missing, tuple(notes))


def _draw(corpus: Corpus, pair: tuple[int, int], pairs: int) -> tuple[Window, ...]:
    """The legacy windows in two clips, recording 1 first."""
    clips: tuple[Clip, Clip] = (corpus.clips[pair[0]], corpus.clips[pair[1]])
    for clip in clips:
        if clip.frames <= LEGACY_FIRST + LEGACY_RESERVE:
            raise DataError(
                clip.name or "clip",
                f"{clip.frames} frames at {clip.fps:g} fps; the windows of this protocol need "
                f"more than {LEGACY_FIRST + LEGACY_RESERVE}",
            )
    starts = legacy_starts((clips[0].frames, clips[1].frames), pairs)
    return tuple(Window(clip=pair[recording], start=start) for recording, start in starts)


def _folder(corpus: Corpus, indices: Sequence[int]) -> str:
    """The folder of the one subject these clips are of, as ``S5/``; empty where unlabelled."""
    subjects = {corpus.clips[index].labels.get("subject", "") for index in indices} - {""}
    return f"{subjects.pop()}/" if len(subjects) == 1 else ""


def _spread(windows: Sequence[Window], limit: int) -> list[Window]:
    """As many of the windows as allowed, evenly from the first to the last."""
    last = len(windows) - 1
    return [windows[round(place * last / max(limit - 1, 1))] for place in range(limit)]


def _some(names: Sequence[str], limit: int = 8) -> str:
    """The first few names, and how many there are."""
    rest = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + rest

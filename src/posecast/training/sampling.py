"""Which windows an epoch sees: every random choice addressed by (seed, epoch, step).

The global batch is the same on every process and each takes its share of it, so a run does not
depend on how many processes it is spread over, nor on whether it was interrupted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Int
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion import Motion
from posecast.motion.corpus import Corpus, Window
from posecast.training import augmentation
from posecast.training.schedules import derived_generator


@runtime_checkable
class Sampling(Protocol):
    """Chooses the recordings of an epoch."""

    def steps(self, recordings: int, batch: int) -> int:
        """Batches in an epoch."""
        ...

    def draw(
        self, frames: Int[Tensor, "recordings"], batch: int, generator: torch.Generator
    ) -> Int[Tensor, "windows"]:
        """Index of the recording of each window of an epoch, in order.

        Args:
            frames: length of each recording.
            batch: windows in a batch.
            generator: on the CPU; the only source of randomness.
        """
        ...


@dataclass(frozen=True)
class EveryRecording:
    """Each recording once an epoch, in random order; the last batch may be smaller.

    Args:
        chunks_per_recording: windows from each recording in an epoch; more than one for a corpus
            of few long recordings.

    Source: the short-term training of Pavllo et al. 2018.
    """

    chunks_per_recording: int = 1

    def __post_init__(self) -> None:
        if self.chunks_per_recording < 1:
            raise ConfigError(f"chunks_per_recording is {self.chunks_per_recording}: expected >= 1")

    def steps(self, recordings: int, batch: int) -> int:
        """As many as it takes to see every recording."""
        return math.ceil(recordings * self.chunks_per_recording / batch)

    def draw(
        self, frames: Int[Tensor, "recordings"], batch: int, generator: torch.Generator
    ) -> Int[Tensor, "windows"]:
        """A permutation of all (recording, chunk) pairs."""
        windows = len(frames) * self.chunks_per_recording
        return torch.randperm(windows, generator=generator) % len(frames)


@dataclass(frozen=True)
class RandomRecordings:
    """Recordings drawn with replacement.

    Args:
        steps_per_epoch: batches in an epoch; ``None``: as many as would hold every recording once.
        weight: ``"length"``: in proportion to their frames, as in QuaterNet's long-term training;
            ``"equal"``: all alike, as in Zhou et al. 2018 and Martinez et al. 2017.
    """

    steps_per_epoch: int | None = None
    weight: Literal["length", "equal"] = "length"

    def __post_init__(self) -> None:
        if self.steps_per_epoch is not None and self.steps_per_epoch < 1:
            raise ConfigError(f"steps_per_epoch is {self.steps_per_epoch}: expected >= 1")
        if self.weight not in ("length", "equal"):
            raise ConfigError(f"weight: {self.weight!r} is not known; choose 'length' or 'equal'")

    def steps(self, recordings: int, batch: int) -> int:
        """As set, or as many as would hold every recording once."""
        return self.steps_per_epoch or math.ceil(recordings / batch)

    def draw(
        self, frames: Int[Tensor, "recordings"], batch: int, generator: torch.Generator
    ) -> Int[Tensor, "windows"]:
        """Independent draws, a full batch in every step."""
        weights = frames.double() if self.weight == "length" else torch.ones(len(frames))
        windows = self.steps(len(frames), batch) * batch
        return torch.multinomial(weights, windows, replacement=True, generator=generator)


SAMPLINGS: dict[str, Callable[..., Sampling]] = {
    "every_recording": EveryRecording,
    "random_recordings": RandomRecordings,
}


class Batch(NamedTuple):
    """One process's share of a batch.

    Args:
        motion: the windows.
        weight: factor of the mean loss over ``motion`` so that the mean over processes is the mean
            over the whole batch; 1 when the batch divides evenly. A process without a window gets
            one to compute with, of weight 0.
        windows: windows of the whole batch.
    """

    motion: Motion
    weight: float
    windows: int


class Windows:
    """The training windows of a corpus, batch by batch.

    Args:
        corpus: recordings of at least ``length`` frames take part.
        length: frames in a window.
        batch: windows in a batch, over all processes together.
        seed: of every choice made here.
        sampling: which recordings an epoch sees; the first frame of each window is uniform.
        turn: turn each window about the vertical by an angle uniform in (-2 pi, 2 pi).
        mirror: exchange left and right in every second window, by chance.
        skip_start: frames at the start of every recording that are in no window.
        skip_end: the same at its end.
        tracks: names of the tracks that come along.
        split: name of the split to read; never the one that is tested on.
        dtype: of the windows.

    Raises:
        ConfigError: no recording is long enough, a size is below 1, or a skeleton to be mirrored
            has no left and right.
    """

    def __init__(
        self,
        corpus: Corpus,
        *,
        length: int,
        batch: int,
        seed: int,
        sampling: Sampling | None = None,
        turn: bool = False,
        mirror: bool = False,
        skip_start: int = 0,
        skip_end: int = 0,
        tracks: Sequence[str] = (),
        split: str = "train",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if length < 1 or batch < 1:
            raise ConfigError(f"windows of {length} frames in batches of {batch}: expected >= 1")
        edges = skip_start + skip_end
        lengths = {index: corpus.frames[index] - edges for index in corpus.indices(split)}
        kept = {index: frames for index, frames in lengths.items() if frames >= length}
        if not kept:
            raise ConfigError(
                f"no recording of split {split!r} of {corpus.name} has the {length} frames of one "
                f"training window; the longest of {len(lengths)} has "
                f"{max(0, *lengths.values())}"
                + (f" beside the {edges} that are skipped" if edges else "")
                + ": shorten prefix + horizon"
                + (", or skip fewer (skip_start, skip_end)" if edges else "")
            )
        if mirror and not corpus.skeleton.left_right_pairs:
            raise ConfigError(
                "mirrored windows were asked for, but no two joint names differ by left and right; "
                "set mirror to false"
            )
        self.corpus, self.length, self.batch, self.seed = corpus, length, batch, seed
        self.sampling = sampling or EveryRecording()
        self.turn, self.mirror, self.dtype = turn, mirror, dtype
        self.tracks = tuple(tracks)
        self.first = skip_start
        self.recordings = torch.tensor(list(kept))
        self.frames = torch.tensor(list(kept.values()))
        self.skipped = len(lengths) - len(kept)
        self._drawn: tuple[int, list[Window]] = (-1, [])

    @property
    def steps(self) -> int:
        """Batches in an epoch."""
        return self.sampling.steps(len(self.recordings), self.batch)

    def windows(self, epoch: int) -> list[Window]:
        """All windows of an epoch, in order."""
        if self._drawn[0] != epoch:
            generator = derived_generator(self.seed, "windows", epoch)
            chosen = self.sampling.draw(self.frames, self.batch, generator)
            # In float64 the product cannot round up to the excluded end for any real recording.
            uniform = torch.rand(len(chosen), generator=generator, dtype=torch.float64)
            starts = self.first + (uniform * (self.frames[chosen] - self.length + 1)).long()
            pairs = zip(self.recordings[chosen].tolist(), starts.tolist(), strict=True)
            self._drawn = epoch, [Window(clip, start) for clip, start in pairs]
        return self._drawn[1]

    def share(self, epoch: int, step: int, *, rank: int = 0, ranks: int = 1) -> Batch:
        """What process ``rank`` of ``ranks`` computes in one step of an epoch, both from 0."""
        whole = self.windows(epoch)[step * self.batch : (step + 1) * self.batch]
        own = slice(rank, None, ranks) if rank < len(whole) else slice(0, 1)
        weight = len(whole[own]) * ranks / len(whole) if rank < len(whole) else 0.0
        gathered = self.corpus.gather(whole[own], self.length, self.tracks)
        motion = gathered.map(lambda values: values.to(self.dtype))
        generator = derived_generator(self.seed, "augmentation", epoch, step)
        # Drawn for the whole batch, used or not, so that the share does not change the draws.
        turns = (4 * torch.rand(len(whole), generator=generator, dtype=torch.float64) - 2) * math.pi
        mirrored = torch.rand(len(whole), generator=generator) < 0.5
        if self.turn:
            motion = augmentation.turn(motion, turns[own].to(self.dtype), self.corpus.skeleton)
        if self.mirror:
            motion = augmentation.mirror(motion, mirrored[own], self.corpus.skeleton)
        return Batch(motion, weight, len(whole))

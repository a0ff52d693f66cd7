"""How the command line reads motion files: with what the user gives in place of what they lack."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posecast.config import did_you_mean, read_yaml
from posecast.errors import ConfigError, PosecastError

if TYPE_CHECKING:
    from posecast.motion import Clip

_MOST_FPS = 10_000
_FOR = {"unit": "BVH", "up": "BVH", "skeleton": "AMC", "template": "AMASS"}


class Reading:
    """The options that say how files are read; each goes to the files whose format has it.

    Args:
        fps: the true frame rate of all files; ``None``: what they say.
        options: by name, of the readers; ``None``: not given.

    Raises:
        ConfigError: a rate that no recording has, or an axis that is none.
    """

    def __init__(self, fps: float | None = None, **options: Any) -> None:
        if fps is not None:
            check_rate("--fps", fps)
        if options.get("up") not in (None, "x", "y", "z"):
            raise ConfigError(f"--up {options['up']}: expected x, y or z")
        self.fps = fps
        self.options = {name: value for name, value in options.items() if value is not None}

    def check(self, files: Iterable[Path]) -> None:
        """Refuse an option that none of the files has a use for.

        Raises:
            ConfigError: it names the format that has one.
        """
        unused = set(self.options)
        for path in files:
            unused -= set(self._own(path))
        for name in sorted(unused):
            raise ConfigError(f"--{name} is for {_FOR[name]} files, and there is none here")

    def clip(self, path: Path) -> Clip:
        """Read any motion file."""
        from posecast.io import read_clip

        return read_clip(path, fps=self.fps, **self._own(path))

    def _own(self, path: Path) -> dict[str, Any]:
        """The options that a file's format has; none where reading it will say what is wrong."""
        from posecast.io import reader_options

        if not self.options:
            return {}
        try:
            known = reader_options(path)
        except PosecastError:
            return {}
        return {name: value for name, value in self.options.items() if name in known}


def check_rate(option: str, fps: float) -> None:
    """Refuse a frame rate that no recording has, before it asks for frames without number.

    Raises:
        ConfigError: naming the option.
    """
    if not 0 < fps <= _MOST_FPS:
        raise ConfigError(
            f"{option} {fps:g}: expected frames per second, above 0 and at most {_MOST_FPS}"
        )


def with_action(clip: Clip, action: str | None, known: Sequence[str]) -> Clip:
    """The clip, labelled with what is done in it.

    Args:
        clip: any clip.
        action: what the user says; ``None``: what the clip says.
        known: actions that a checkpoint tells apart; none if it is not told.

    Raises:
        ConfigError: an action that the checkpoint does not know, or none where it needs one, or
            one for a checkpoint that is not told.
    """
    if not known:
        if action is not None:
            raise ConfigError(
                f"--action {action}: this checkpoint is not told what is done; leave it out"
            )
        return clip
    shown = clip.labels.get("action", "") if action is None else action
    if shown not in known:
        found = f"action {shown!r} is unknown" if shown else "this checkpoint is told what is done"
        raise ConfigError(f"{clip.name}: {found}; give --action; {did_you_mean(shown, known)}")
    return replace(clip, labels={**clip.labels, "action": shown})


def read_mapping(path: Path) -> dict[str, str]:
    """A YAML file of joint names: those of a checkpoint, each with its name in a clip.

    Raises:
        ConfigError: it cannot be read, or is no mapping of names to names.
    """
    names = read_yaml(path)
    for new, old in names.items():
        if not isinstance(old, str):
            raise ConfigError(f"{path}: {new}: found {old!r}, expected the name of a joint")
    return {str(new): old for new, old in names.items()}

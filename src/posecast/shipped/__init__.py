"""Trained systems that come with posecast, each a checkpoint folder with a card beside it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import yaml

from posecast.checkpoint import WEIGHTS, is_checkpoint

FOLDER = Path(__file__).parent
CARD, ABOUT = "card.md", "model.yaml"


class Shipped(NamedTuple):
    """A trained system that comes with posecast.

    Args:
        name: what the command line takes in place of a folder.
        folder: its checkpoint.
        summary: what it does, in a line.
        data: what it was trained on.
        license: of its weights.
        megabytes: of its weights.
    """

    name: str
    folder: Path
    summary: str
    data: str
    license: str
    megabytes: float

    @property
    def card(self) -> str:
        """Data, licence, scores and how to train it again, in Markdown."""
        return (self.folder / CARD).read_text("utf-8")


def shipped_models() -> list[Shipped]:
    """All of them, by name."""
    return [_read(folder) for folder in sorted(FOLDER.iterdir()) if is_checkpoint(folder)]


def checkpoint_folder(place: str | Path) -> Path:
    """A folder as it is, or that of a shipped model of this name where there is no such folder."""
    name = str(place)
    if not Path(place).exists() and name in {model.name for model in shipped_models()}:
        return FOLDER / name
    return Path(place)


def _read(folder: Path) -> Shipped:
    about = yaml.safe_load((folder / ABOUT).read_text("utf-8"))
    size = (folder / WEIGHTS).stat().st_size / 1e6
    return Shipped(folder.name, folder, about["summary"], about["data"], about["license"], size)

"""Controls: what steers a walk, as numbers a frame beside the features."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion.tracks import FACING, MOVEMENT, PHASE, SPEED, STYLE


@dataclass(frozen=True)
class Controls:
    """The place in the walk cycle, where to go, how fast, where to look, and in which style.

    In this order: speed times cosine and sine of the phase; the direction of movement (x, z), times
    the speed or as it is; the direction faced (x, z); 1 for the style among zeros. Speeds in m/s.

    Args:
        styles: names of styles, the label ``style`` of clips; none: the style is no control.
        movement: ``scaled`` by the speed, as in QuaterNet's code, or a ``unit`` vector, as in the
            texts.

    Source: Pavllo et al. 2018, section 3.4; 2020, section 3.7.
    """

    styles: tuple[str, ...] = ()
    movement: str = "scaled"

    def __post_init__(self) -> None:
        if self.movement not in ("scaled", "unit"):
            raise ConfigError(
                f"controls.movement: {self.movement!r} is not known; choose 'scaled' or 'unit'"
            )
        twice = sorted({name for name in self.styles if self.styles.count(name) > 1})
        if twice:
            raise ConfigError(f"controls.styles: {twice[0]!r} is there twice; name each once")

    @property
    def dim(self) -> int:
        """Number of controls a frame."""
        return len(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """What each of the numbers is."""
        steps = ("step_cos", "step_sin", "movement_x", "movement_z", "facing_x", "facing_z")
        return (*steps, *(f"style.{style}" for style in self.styles))

    @property
    def tracks(self) -> tuple[str, ...]:
        """Names of the tracks that they are made of."""
        return (PHASE, SPEED, MOVEMENT, FACING, *((STYLE,) if self.styles else ()))

    def encode(
        self, tracks: Mapping[str, Float[Tensor, "*batch frames ..."]]
    ) -> Float[Tensor, "*batch frames controls"]:
        """Controls of frames.

        Args:
            tracks: those of ``tracks``, with the meaning that ``motion.tracks`` gives them.

        Raises:
            ConfigError: a track is missing.
        """
        missing = [name for name in self.tracks if name not in tracks]
        if missing:
            raise ConfigError(
                f"controls are made of the tracks {', '.join(self.tracks)}; the motion lacks "
                f"{', '.join(missing)}: analyse its gait first (motion.gait)"
            )
        phase, speed = tracks[PHASE], tracks[SPEED][..., None]
        step = torch.stack([phase.cos(), phase.sin()], dim=-1) * speed
        movement = tracks[MOVEMENT] * speed if self.movement == "scaled" else tracks[MOVEMENT]
        parts = [step, movement, tracks[FACING]]
        if self.styles:
            parts.append(tracks[STYLE])
        return torch.cat(parts, dim=-1)

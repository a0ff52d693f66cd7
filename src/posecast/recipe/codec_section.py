"""The section ``codec`` of a recipe: its keys are the keywords of ``codec_of_section``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, get_args

from posecast.config import check_call, did_you_mean
from posecast.corpora import h36m
from posecast.errors import ConfigError, SkeletonError
from posecast.representation import Codec, Controls, Representation, RootChannels, Statistics
from posecast.skeleton import Skeleton
from posecast.skeleton.catalog import named_skeleton

ACTION_LISTS: Mapping[str, tuple[str, ...]] = {"h36m": h36m.ACTIONS}
"""Actions of corpora, for ``codec.actions``."""

Standardize = Literal["none", "deviation", "variance"]


def codec_of_section(
    skeleton: Skeleton,
    represent: Callable[[Skeleton], Representation],
    statistics: Statistics | None,
    *,
    root: RootChannels = "none",
    standardize: Standardize = "none",
    joints: str | list[str] | None = None,
    actions: str | list[str] | None = None,
    controls: dict[str, object] | None = None,
) -> Codec:
    """A codec from a recipe's section ``codec``; its keywords are that section's keys."""
    if standardize not in get_args(Standardize):
        raise ConfigError(f"codec.standardize: {standardize!r} is not known")
    if isinstance(actions, str) and actions not in ACTION_LISTS:
        known = did_you_mean(actions, ACTION_LISTS)
        raise ConfigError(f"codec.actions: {actions!r} is no list of actions; {known}")
    told = ACTION_LISTS[actions] if isinstance(actions, str) else tuple(actions or ())
    written, chosen = skeleton, None
    if joints is not None:
        try:
            names = named_skeleton(joints).skeleton.names if isinstance(joints, str) else joints
            chosen = tuple(sorted({skeleton.index(name) for name in names}))
            written = skeleton.select(chosen)
        except SkeletonError as error:
            raise ConfigError(f"codec.joints: {error}") from None
    return Codec(
        skeleton,
        represent(written),
        root=root,
        statistics=statistics,
        joints=chosen,
        actions=told,
        controls=None if controls is None else steering(controls),
    )


def steering(section: Mapping[str, object]) -> Controls:
    """Controls from the section ``codec.controls``; its keys are the constructor's keywords.

    Raises:
        ConfigError: a key that is not known, or a value of the wrong type.
    """
    check_call(Controls, section, where="controls")
    styles = section.get("styles", ())
    movement = str(section.get("movement", "scaled"))
    assert isinstance(styles, list | tuple)
    return Controls(tuple(map(str, styles)), movement)

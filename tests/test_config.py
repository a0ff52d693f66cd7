"""Recipes: overrides, merging, and the wording of the commonest mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest

from posecast.config import (
    check_call,
    check_keys,
    merge,
    parse_overrides,
    pick_kind,
    read_yaml,
)
from posecast.errors import ConfigError


def _backbone(
    input_dim: int,
    *,
    hidden: int,
    layers: int = 2,
    dropout: float = 0.0,
    initial_state: Literal["learned", "zero"] = "learned",
    name: str | None = None,
) -> None:
    """A constructor to check against."""


def test_overrides_have_their_yaml_types() -> None:
    assert parse_overrides(
        ["a.b=1", "a.c=0.5", "a.d=true", "e=null", "f=[1, 2]", "g=walk", "h={x: 1}"]
    ) == {
        "a": {"b": 1, "c": 0.5, "d": True},
        "e": None,
        "f": [1, 2],
        "g": "walk",
        "h": {"x": 1},
    }


@pytest.mark.parametrize("override", ["training.epochs", "=3", "a..b=3", "a={b"])
def test_a_malformed_override_is_quoted_in_the_error(override: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_overrides([override])
    assert repr(override) in str(caught.value)


def test_merging_goes_key_by_key_and_does_not_change_its_arguments() -> None:
    base = {"model": {"hidden": 1000, "layers": 2}, "epochs": 3}
    assert merge(base, {"model": {"hidden": 64}}) == {
        "model": {"hidden": 64, "layers": 2},
        "epochs": 3,
    }
    assert base["model"] == {"hidden": 1000, "layers": 2}


def test_another_kind_replaces_the_whole_section() -> None:
    base = {"feed": {"kind": "scheduled_sampling", "decay": 0.995}}
    assert merge(base, {"feed": {"kind": "teacher_forcing"}}) == {
        "feed": {"kind": "teacher_forcing"}
    }


def test_a_misspelled_key_names_its_place_and_the_nearest() -> None:
    with pytest.raises(ConfigError) as caught:
        check_call(_backbone, {"hiden": 3}, where="model.backbone", provided={"input_dim"})
    assert "model.backbone.hiden: unknown key; did you mean 'hidden'?" in str(caught.value)


def test_what_the_program_provides_is_no_key_of_a_recipe() -> None:
    with pytest.raises(ConfigError, match=r"model\.backbone\.input_dim: unknown key"):
        check_call(
            _backbone, {"hidden": 3, "input_dim": 4}, where="model.backbone", provided={"input_dim"}
        )


def test_a_missing_argument_is_named() -> None:
    with pytest.raises(ConfigError, match=r"model\.backbone: hidden must be given"):
        check_call(_backbone, {}, where="model.backbone", provided={"input_dim"})


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("hidden", "many", "a whole number"),
        ("hidden", 2.5, "a whole number"),
        ("hidden", True, "a whole number"),
        ("dropout", "some", "a number"),
        ("initial_state", "random", "one of 'learned', 'zero'"),
        ("name", 3, "text or null"),
    ],
)
def test_a_value_of_another_type_says_what_was_expected(
    key: str, value: object, expected: str
) -> None:
    arguments = {"hidden": 3, key: value}
    with pytest.raises(ConfigError) as caught:
        check_call(_backbone, arguments, where="backbone", provided={"input_dim"})
    assert f"backbone.{key}: found {value!r}, expected {expected}" in str(caught.value)


def test_good_arguments_pass() -> None:
    check_call(
        _backbone,
        {"hidden": 3, "dropout": 0, "initial_state": "zero", "name": None},
        where="backbone",
        provided={"input_dim"},
    )


def test_an_unknown_kind_names_the_nearest() -> None:
    with pytest.raises(
        ConfigError, match=r"model\.head\.kind: unknown 'dens'; did you mean 'dense'"
    ):
        pick_kind({"dense": _backbone}, {"kind": "dens"}, "model.head")
    with pytest.raises(ConfigError, match="expected a section with 'kind', one of dense"):
        pick_kind({"dense": _backbone}, {}, "model.head")


def test_keys_that_nobody_reads_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"recipe\.corpous: unknown key; did you mean 'corpus'"):
        check_keys({"corpous": 1}, {"corpus", "model"}, "recipe")


@pytest.mark.parametrize("text", ["a: [1", "- 1\n- 2\n", "\x00\x01", "a: ${missing}"])
def test_a_file_that_is_no_mapping_is_one_line_of_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_yaml(path)
    assert "recipe.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)

"""The recipes that come with the package, and those of users: YAML files, laid over each other.

A recipe may have a section ``small``: what to change so that two CPU cores can train it. The name
of the recipe with ``-small`` behind it is the recipe with these changes.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from posecast.config import did_you_mean, merge, parse_overrides, read_yaml
from posecast.errors import ConfigError
from posecast.recipe.system_recipe import CORPUS_SKELETONS, Recipe

RECIPES = Path(__file__).parents[1] / "recipes"
SMALL = "-small"


@cache
def list_recipes() -> tuple[str, ...]:
    """Names of the recipes that come with the package."""
    names = {path.stem for path in RECIPES.glob("*.yaml")}
    whole = (name for name in names if not name.endswith(SMALL))
    small = {f"{name}{SMALL}" for name in whole if "small" in _with_base(RECIPES / f"{name}.yaml")}
    return tuple(sorted(names | small))


def load_recipe(name: str, overrides: Iterable[str] = (), *, corpus: str | None = None) -> Recipe:
    """A recipe by name or path, with ``key.path=value`` overrides laid over it.

    Args:
        name: one of ``list_recipes``, or the path of a YAML file.
        overrides: such as ``training.epochs=100``.
        corpus: another corpus in the place of the recipe's, with that corpus's defaults.

    Raises:
        ConfigError: no such recipe, or something in it does not fit.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        if name not in list_recipes():
            raise ConfigError(f"no recipe is called {name!r}; {did_you_mean(name, list_recipes())}")
        path = RECIPES / f"{name}.yaml"
    config = _resolve(path)
    if corpus is not None:
        config = merge(config, {"corpus": {"kind": corpus}})
    recipe = Recipe({"name": path.stem, **merge(config, parse_overrides(overrides))})
    recipe.protocol.frames(recipe.fps)  # refuses now what could not be scored after training
    return recipe


def _resolve(path: Path) -> dict[str, Any]:
    """A recipe without its small form; or, by a name that ends so, with that laid over it."""
    whole = path.with_name(f"{path.stem.removesuffix(SMALL)}{path.suffix}")
    if path.is_file() or whole == path or not whole.is_file():
        config = _with_base(path)
        config.pop("small", None)
        return config
    config = _with_base(whole)
    if "small" not in config:
        raise ConfigError(f"{whole.stem} has no small form: it needs a section 'small'")
    small = config.pop("small")
    summary = str(config.get("summary")).removesuffix(", paper size")
    words = {"summary": f"{summary}, small, for two CPU cores", "expect": "see docs/results.md"}
    return merge({**config, **words}, small)


def _with_base(path: Path) -> dict[str, Any]:
    """A recipe laid over the one it extends. One level: chains hide what a system is."""
    own = read_yaml(path)
    base_name = own.pop("extends", None)
    if base_name is None:
        return own
    beside = path.with_name(f"{base_name}.yaml")
    base_path = beside if beside.is_file() else RECIPES / f"{base_name}.yaml"
    if not base_path.is_file():
        raise ConfigError(
            f"{path.stem}: extends {base_name!r}, which does not exist; "
            f"{did_you_mean(str(base_name), list_recipes())}"
        )
    base = read_yaml(base_path)
    if "extends" in base:
        raise ConfigError(
            f"{path.stem}: extends {base_name!r}, which itself extends {base['extends']!r}; "
            f"extend {base['extends']!r} and repeat what {base_name!r} adds to it, or train "
            f"{base_name!r} with overrides (KEY=VALUE)"
        )
    return merge(base, own)


def count_parameters(recipe: Recipe) -> int | None:
    """Number of trained values of a recipe's network; its weights are never allocated.

    ``None`` where the skeleton is known only from the files of the recipe's corpus.
    """
    kind = recipe.config["corpus"]["kind"]
    if kind not in CORPUS_SKELETONS:
        return None
    forecaster = recipe.outline(recipe.build_codec(CORPUS_SKELETONS[kind]()))
    return sum(weight.numel() for weight in forecaster.parameters())

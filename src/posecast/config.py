"""Recipes and overrides (OmegaConf) to constructor calls; the signature is the schema.

A section of a recipe such as ``{kind: gru, hidden: 1000}`` names a member of a closed table by
``kind``; its other keys are that constructor's own arguments. Every key is checked against the
signature before anything is built, so that a misspelled key costs no time.
"""

from __future__ import annotations

import difflib
import inspect
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from posecast.errors import ConfigError

_TYPE_NAMES = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}


def did_you_mean(found: str, known: Iterable[str]) -> str:
    """A remedy for a name that is not known: the nearest one, and all of them."""
    names = sorted(known)
    near = difflib.get_close_matches(found, names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}known: {', '.join(names) if names else '(none)'}"


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML file with a mapping at its top.

    Raises:
        ConfigError: it cannot be read, is not YAML, or holds no mapping.
    """
    try:
        loaded = OmegaConf.load(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (YAMLError, OmegaConfBaseException, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    if not isinstance(loaded, DictConfig):
        raise ConfigError(f"{path}: expected a mapping of keys to values at the top")
    return to_plain(loaded, str(path))


def to_plain(config: DictConfig, where: str) -> dict[str, Any]:
    """Nested dictionaries and lists, interpolations resolved."""
    try:
        plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise ConfigError(f"{where}: {' '.join(str(error).split())}") from None
    return typing.cast(dict[str, Any], plain)


def merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """``change`` laid over ``base``, key by key.

    A section whose ``kind`` changes is replaced whole: the arguments of one kind mean nothing to
    another.
    """
    merged: dict[str, Any] = dict(base)
    for key, value in change.items():
        below = merged.get(key)
        other_kind = (
            isinstance(value, Mapping)
            and isinstance(below, Mapping)
            and "kind" in value
            and value["kind"] != below.get("kind")
        )
        if isinstance(value, Mapping) and isinstance(below, Mapping) and not other_kind:
            merged[key] = merge(below, value)
        else:
            merged[key] = value
    return merged


def parse_overrides(overrides: Iterable[str]) -> dict[str, Any]:
    """``["training.epochs=10", "model.residual=add"]`` as nested dictionaries.

    Values are read as YAML: numbers, true/false, null, lists and mappings have their usual form.

    Raises:
        ConfigError: an override has no ``=``, an empty key, or a value that is not YAML.
    """
    result: dict[str, Any] = {}
    for override in overrides:
        key, equals, _ = override.partition("=")
        if not equals or not key or not all(key.split(".")):
            raise ConfigError(
                f"override {override!r}: expected KEY=VALUE, for example training.epochs=100"
            )
        try:
            parsed = OmegaConf.from_dotlist([override])
        except (YAMLError, OmegaConfBaseException) as error:
            raise ConfigError(f"override {override!r}: {' '.join(str(error).split())}") from None
        result = merge(result, to_plain(parsed, f"override {override!r}"))
    return result


def check_keys(section: Mapping[str, Any], known: Collection[str], where: str) -> None:
    """Refuse keys that nobody reads.

    Raises:
        ConfigError: naming the key, its place and the nearest known one.
    """
    for key in section:
        if key not in known:
            raise ConfigError(f"{where}.{key}: unknown key; {did_you_mean(str(key), known)}")


def check_call(
    factory: Callable[..., Any],
    arguments: Mapping[str, Any],
    *,
    where: str,
    provided: Collection[str] = (),
) -> None:
    """Check ``arguments`` against the signature of ``factory`` without calling it.

    Args:
        factory: a class or function; its keyword parameters are the schema.
        arguments: what the recipe says.
        where: place in the recipe, for messages, such as ``model.backbone``.
        provided: parameters that the program fills in; a recipe may not set them.

    Raises:
        ConfigError: an unknown, missing or ill-typed argument.
    """
    parameters = {
        name: parameter
        for name, parameter in inspect.signature(factory).parameters.items()
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
        and name not in provided
    }
    check_keys(arguments, parameters, where)
    missing = [
        name
        for name, parameter in parameters.items()
        if parameter.default is parameter.empty and name not in arguments
    ]
    if missing:
        raise ConfigError(f"{where}: {', '.join(missing)} must be given")
    hints = typing.get_type_hints(factory.__init__ if inspect.isclass(factory) else factory)
    for name, value in arguments.items():
        if name in hints and not _fits(value, hints[name]):
            raise ConfigError(f"{where}.{name}: found {value!r}, expected {_describe(hints[name])}")


def pick_kind(
    table: Mapping[str, Callable[..., Any]], section: Mapping[str, Any], where: str
) -> tuple[Callable[..., Any], dict[str, Any]]:
    """The member of ``table`` that ``section['kind']`` names, and the remaining keys.

    Raises:
        ConfigError: ``kind`` is missing or unknown.
    """
    if not isinstance(section, Mapping) or "kind" not in section:
        raise ConfigError(f"{where}: expected a section with 'kind', one of {', '.join(table)}")
    kind = section["kind"]
    if not isinstance(kind, str) or kind not in table:
        raise ConfigError(f"{where}.kind: unknown {kind!r}; {did_you_mean(str(kind), table)}")
    return table[kind], {key: value for key, value in section.items() if key != "kind"}


def _fits(value: Any, hint: Any) -> bool:
    """Whether a YAML value can stand for a parameter annotated ``hint``."""
    origin = typing.get_origin(hint)
    if hint is Any or isinstance(hint, str):
        return True
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, option) for option in typing.get_args(hint))
    if origin is typing.Literal:
        return value in typing.get_args(hint)
    if hint is type(None):
        return value is None
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if hint in (bool, str):
        return isinstance(value, hint)
    if hint is Path:
        return isinstance(value, str)
    container = origin or hint
    parts = typing.get_args(hint)
    if inspect.isclass(container):
        if issubclass(container, Mapping):
            items = value.values() if isinstance(value, Mapping) else None
            return items is not None and (not parts or all(_fits(i, parts[1]) for i in items))
        if issubclass(container, Collection):
            return isinstance(value, list | tuple) and (
                not parts or all(_fits(item, parts[0]) for item in value)
            )
    return True


def _describe(hint: Any) -> str:
    """A parameter's annotation in words."""
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_describe(option) for option in typing.get_args(hint))
    if origin is typing.Literal:
        return "one of " + ", ".join(repr(option) for option in typing.get_args(hint))
    if hint is type(None):
        return "null"
    container, parts = origin or hint, typing.get_args(hint)
    if inspect.isclass(container) and issubclass(container, Mapping) and len(parts) == 2:
        return f"keys, each with {_describe(parts[1])}"
    if inspect.isclass(container) and issubclass(container, Collection) and parts:
        return f"a list, each item {_describe(parts[0])}"
    return _TYPE_NAMES.get(hint, str(getattr(hint, "__name__", hint)))

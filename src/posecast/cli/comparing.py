"""What ``posecast compare`` does: several systems on equal terms, one table, one plot, one film."""

from __future__ import annotations

import csv
import json
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from posecast.cli.compared import Contestant, Cost, to_json, to_markdown
from posecast.cli.terminal import read_corpus, say
from posecast.errors import ConfigError
from posecast.evaluation import Protocol, Report, baseline_scores, build_protocol
from posecast.io.atomic import atomic_write
from posecast.motion import Motion
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe, load_recipe
from posecast.system import System, check, load, train
from posecast.training.keeping import BEST, LAST, LOG, VALIDATIONS

PICTURE_MS = 3000  # how much of a forecast the film shows
FREE_TO_DIFFER = ("objective", "adversary", "seed", "feedback_gradient")
"""Keys of ``training`` that are part of a system, not of the terms it is compared on."""


def compare_systems(
    names: Sequence[str],
    overrides: Sequence[str],
    out: Path,
    *,
    corpus: str | None,
    root: Path | None,
    protocol: str | None,
    seeds: int,
    progress: bool = True,
) -> str:
    """Train what is not trained yet, score everything on the same windows, and write it to ``out``.

    A comparison may be stopped at any moment; the same call goes on. Runs are in
    ``out/RECIPE/SEED``; ``comparison.md``, ``comparison.json``, ``convergence.png`` and
    ``comparison.gif`` are written anew.

    Args:
        names: recipes; those that share everything but representation, network and losses.
        overrides: of every recipe, such as ``training.epochs=10``.
        out: folder.
        corpus: kind of corpus in the place of the recipes'.
        root: folder of the corpus.
        protocol: how to score; ``None``: as the first recipe says.
        seeds: runs of each recipe, with the seeds 0, 1, ...
        progress: show how far training is, on standard error.

    Returns:
        The table, in Markdown.

    Raises:
        ConfigError: no recipe, one named twice, recipes on unequal terms, an override of what
            tells runs apart, or a run in ``out`` with other settings; nothing is trained then.
    """
    if not names:
        raise ConfigError("nothing to compare; name recipes, see posecast recipes")
    for key in ("name", "training.seed"):
        if any(each.partition("=")[0].strip() == key for each in overrides):
            raise ConfigError(f"{key} tells the runs apart; leave it out (--seeds N for more runs)")
    if seeds < 1:
        raise ConfigError(f"--seeds {seeds}: expected 1 or more")
    recipes = [
        [
            load_recipe(name, [*overrides, f"training.seed={seed}"], corpus=corpus)
            for seed in range(seeds)
        ]
        for name in names
    ]
    first = recipes[0][0]
    called = [runs[0].name for runs in recipes]
    if len(set(called)) < len(called):
        raise ConfigError(f"{', '.join(called)}: a recipe is named twice; name each once")
    for runs in recipes[1:]:
        _check_terms(first, runs[0])
    chosen = first.protocol if protocol is None else build_protocol(protocol)
    chosen.frames(first.fps)
    data = read_corpus(first, root)
    chosen.windows(data)
    for runs in recipes:
        check_runs(runs, data, out)
    contestants = [contest(runs, data, chosen, out, progress=progress) for runs in recipes]
    say("scoring the baselines")
    baselines = baseline_scores(chosen, data)
    text = to_markdown(contestants, baselines, data)
    write(out / "comparison.md", text)
    write(out / "comparison.json", json.dumps(to_json(contestants, baselines), indent=1) + "\n")
    _draw(contestants, data, chosen, out)
    return text


def _check_terms(first: Recipe, other: Recipe) -> None:
    """Refuse two recipes that differ in more than representation, network and losses."""
    one, two = (_terms(each) for each in (first, other))
    differing = [key for key in {**one, **two} if one.get(key) != two.get(key)]
    if differing:
        key = differing[0]
        raise ConfigError(
            f"{first.name} and {other.name} are not on equal terms: {key} is {one.get(key)!r} and "
            f"{two.get(key)!r}"
            + (f", and so on ({', '.join(differing[1:])})" if differing[1:] else "")
            + f"; give all the same with {key}=VALUE, or compare others"
        )


def _terms(recipe: Recipe) -> dict[str, Any]:
    """What must be the same for a fair comparison, by dotted names."""
    config = recipe.config
    training = {
        f"training.{key}": value
        for key, value in config["training"].items()
        if key not in FREE_TO_DIFFER
    }
    shared = {key: config[key] for key in ("fps", "corpus", "codec", "protocol")}
    return {**shared, **training}


def check_runs(recipes: Sequence[Recipe], corpus: Corpus, out: Path) -> None:
    """Refuse a run of one recipe that ``contest`` could not train or go on with."""
    for recipe in recipes:
        check(recipe, corpus, _place(recipe, out))


def contest(
    recipes: Sequence[Recipe], corpus: Corpus, protocol: Protocol, out: Path, *, progress: bool
) -> Contestant:
    """Train and score all seeds of one recipe."""
    runs: list[System] = []
    scores = []
    places = [_place(recipe, out) for recipe in recipes]
    for recipe, place in zip(recipes, places, strict=True):
        say(f"{recipe.name}, seed {recipe.plan.seed}: {recipe.plan.epochs} epochs")
        train(recipe, corpus, place, resume=True, progress=progress)
        system = load(place / (BEST if (place / BEST).is_dir() else LAST))
        runs.append(system)
        scores.append(protocol.score(system.predictor, corpus, system=recipe.name))
    logs = [_numbers(place / LOG) for place in places]
    steps = [
        float(row["seconds"]) / (float(row["updates"]) / float(row["epoch"]))
        for rows in logs
        for row in rows
    ]
    return Contestant(
        recipes[0],
        tuple(runs),
        Report(tuple(scores)),
        Cost(
            runs[0].parameters,
            tuple(sum(float(row["seconds"]) for row in rows) for rows in logs),
            1000 * statistics.median(steps),
        ),
        tuple(
            _curve(place, recipe, rows)
            for place, recipe, rows in zip(places, recipes, logs, strict=True)
        ),
    )


def _place(recipe: Recipe, out: Path) -> Path:
    return out / recipe.name / str(recipe.plan.seed)


def _curve(
    place: Path, recipe: Recipe, log: Sequence[Mapping[str, str]]
) -> tuple[tuple[int, float], ...]:
    """(updates, value) of what runs are selected by; of the loss where nothing was validated."""
    if not (place / VALIDATIONS).is_file():
        return tuple((int(row["updates"]), float(row["loss"])) for row in log)
    updates = {row["epoch"]: int(row["updates"]) for row in log}
    rows = _numbers(place / VALIDATIONS)
    key = recipe.plan.select_best_by or list(rows[0])[1]
    # Validations from before a run was asked to measure something else lack it.
    return tuple((updates[row["epoch"]], float(row[key])) for row in rows if row.get(key))


def _numbers(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _draw(contestants: Sequence[Contestant], corpus: Corpus, protocol: Protocol, out: Path) -> None:
    """The convergence plot and the film."""
    from posecast.viewer import draw
    from posecast.viewer.plots import convergence

    selected = contestants[0].recipe.plan.select_best_by
    validated = bool(corpus.splits.get("validation"))
    convergence(
        {each.recipe.name: each.curves for each in contestants},
        out / "convergence.png",
        what=f"validation: {selected or protocol.metrics[0]}" if validated else "training loss",
    )
    prefix, horizons = protocol.frames(corpus.fps)
    titles = short_names([each.recipe.name for each in contestants])
    shown = min(horizons[-1], round(PICTURE_MS * corpus.fps / 1000))
    window = protocol.windows(corpus).groups[0].windows[0]
    clip = corpus.clips[window.clip]
    truth = clip.cut(window.start, min(window.start + prefix + shown, clip.frames))
    known = truth.cut(0, prefix).motion()
    forecasts = [
        Motion.join_frames([known, each.runs[0].predictor.predict(known, shown).rigid]).clip(
            truth, name=name
        )
        for each, name in zip(contestants, titles, strict=True)
    ]
    say("drawing")
    draw(
        [truth, *forecasts],
        out / "comparison.gif",
        titles=["truth", *titles],
        split_frame=prefix,
    )


def short_names(names: Sequence[str]) -> list[str]:
    """Names without the words that all of them begin and end with."""
    words = [name.split("-") for name in names]
    if len(words) == 1:
        return list(names)
    back = min(_shared([each[::-1] for each in words]), *(len(each) - 1 for each in words))
    words = [each[: len(each) - back] for each in words]
    front = min(_shared(words), *(len(each) - 1 for each in words))
    return ["-".join(each[front:]) for each in words]


def _shared(lists: Sequence[Sequence[str]]) -> int:
    """How many words all lists begin with."""
    for place, words in enumerate(zip(*lists, strict=False)):
        if len(set(words)) > 1:
            return place
    return min(map(len, lists))


def write(path: Path, text: str) -> None:
    """Write a text file whole, or leave the one that was there."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
